"""The process of one run: it owns link, stream and journal, and lives on when the service does not.

``ibfctl.runs.launch.start_worker`` starts ``python -m ibfctl.runs.worker FOLDER LOCK CONTROL``: the folder of the run,
and the descriptors of the lock that says that it lives and of the pipe that acts come through. SIGTERM aborts. The exit
code is that of the run's error, or 0; everything else is in the journal, in the status, and in `run.h5`.
"""

from __future__ import annotations

import logging
import os
import signal
import sys
import time
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path

from ibfctl.errors import ControllerError, IbfctlError, RunError
from ibfctl.runs.adoption import last_state
from ibfctl.runs.conductor import conduct
from ibfctl.runs.control import Act, ControlReader
from ibfctl.runs.drivers import connect
from ibfctl.runs.history import History, history
from ibfctl.runs.job import Job, read_job
from ibfctl.runs.journal import Journal
from ibfctl.runs.leg import end_of
from ibfctl.runs.lock import MachineLock
from ibfctl.runs.places import SIDE, journal_beside
from ibfctl.runs.promptness import ready_to_answer_soon
from ibfctl.runs.recorder import JournalWriter, absorb
from ibfctl.runs.records import record_result
from ibfctl.runs.recovery import recover_own
from ibfctl.runs.reporter import RunReporter
from ibfctl.runs.requests import Requests, When
from ibfctl.runs.result import RunResult
from ibfctl.runs.states import RunState
from ibfctl.runs.status import StatusWriter, read
from ibfctl.runs.tool_change import await_tool
from ibfctl.runs.tools import Part, part_under_way
from ibfctl.runs.wire import WireRecorder

LOOK_AGAIN_S, LOOK_EVERY_S = 30.0, 1.0
FLUSH_S = 5.0

_log = logging.getLogger(__name__)


def main(arguments: list[str] | None = None) -> int:
    """Serve the run of a folder to its end; return the exit code."""
    folder, lock, control = (arguments or sys.argv)[1:]
    for descriptor in (int(lock), int(control)):
        os.set_inheritable(descriptor, False)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(name)s: %(message)s")
    try:
        job = read_job(Path(folder))
        with Worker(Path(folder), job, int(control)) as worker:
            return worker.run()
    except IbfctlError as error:
        _log.error("%s", error)
        return error.exit_code


class Worker:
    """The worker of one run.

    Of several tools the one that is *mounted* is in its preflight, or under way as well.

    Parameters
    ----------
    folder, job
        Of the run.
    control
        Descriptor of the pipe for acts.
    """

    _under_way: Part
    _mounted: Part

    def __init__(self, folder: Path, job: Job, control: int) -> None:
        self._folder = folder
        self._job = job
        self._requests = Requests()
        with Journal.open(journal_beside(folder)) as journal:
            absorb(journal, folder / SIDE)
            state = last_state(journal, job.run)
            self._before = history(journal, job.run)
        shown = read(folder) or {"seq": 0}
        always = {"run": job.run, "state": state, "simulated": job.simulated, "worker_pid": os.getpid()}
        self._status = StatusWriter(folder, always, shown["seq"])
        self._journal = JournalWriter(journal_beside(folder), job.run, folder / SIDE)
        self._wire = WireRecorder(self._journal.record)
        self._report = RunReporter(self._journal, self._status, state)
        self._control = ControlReader(control, self._take, self._refuse)
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda *_: self._take({"act": "abort", "key": None, "by": "a signal"}))

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, *_: object) -> None:
        self._control.close()
        self._wire.flush()
        self._journal.close()
        self._status.close()

    def run(self) -> int:
        """Run the plan, or that of one tool after the other, and record it; return the exit code."""
        try:
            result = self._run_tools()
            if result.uncertainty_samples:
                self._look_again()
        except IbfctlError as error:
            _log.error("%s", error)
            self._end(error)
            return error.exit_code
        except BaseException as error:
            _log.exception("the worker failed")
            self._end(RunError(f"the worker failed: {error!r}", "see worker.log in the run's folder"))
            raise
        return 0 if result.error is None else result.error.exit_code

    def _run_tools(self) -> RunResult:
        """Execute what is under way, then one tool after the other, each when its change is confirmed."""
        self._under_way = self._mounted = part_under_way(self._folder)
        self._show_tool()
        resume_at = self._job.resume_at
        if resume_at is None or resume_at < self._under_way.total_samples or self._under_way.is_last:
            result = self._execute()
        else:
            result = None
            self._report("state", {"state": RunState.RESUMING})
            self._report("state", {"state": RunState.TOOL_CHANGE, **self._under_way.wanted()})
        while self._report.state is RunState.TOOL_CHANGE:
            result = self._execute_next()
        assert result is not None  # nothing else leaves a change of tools without an error
        return result

    def _execute_next(self) -> RunResult | None:
        """Execute the next tool as soon as it is mounted; None where the machine cannot be taken or reached."""
        self._mounted = await_tool(self._folder, self._under_way, self._requests, self._estop)
        self._requests.forget_confirmation()
        self._report("state", {"state": RunState.PREFLIGHT})
        try:
            return self._execute()
        except (ControllerError, RunError) as error:
            if self._report.state is not RunState.PREFLIGHT:
                raise
            self._tell("state", {"state": RunState.FAULTED, "reason": error.message, "hint": error.hint})
            return None

    def _execute(self) -> RunResult:
        """Take the machine, connect, conduct the plan of the mounted tool, record it."""
        with ExitStack() as resources:
            machine = self._job.machine(self._folder)
            resources.enter_context(MachineLock(machine, f"run {self._job.run}"))
            resume_at = self._job.resume_at if self._mounted is self._under_way else None
            if self._report.state is not RunState.PREFLIGHT:
                self._report("state", {"state": RunState.PREFLIGHT if resume_at is None else RunState.RESUMING})
            controller = connect(machine, self._wire)
            resources.callback(controller.close)
            ready_to_answer_soon()
            result = conduct(
                self._mounted.plan,
                machine,
                controller,
                self._requests,
                self._tell,
                time_scale=self._job.speed,
                resume_at=resume_at,
                folder=self._folder,
            )
        if self._mounted is self._under_way:
            record_result(self._folder, self._under_way, self._job, result, self._before)
        return result

    def _estop(self) -> None:
        """Latch the emergency stop on the controller, which between tools nobody is connected to."""
        controller = connect(self._job.machine(self._folder), self._wire)
        try:
            controller.estop()
        finally:
            controller.close()

    def _show_tool(self) -> None:
        """Show which tool is under way; a status without it is of a run with one tool."""
        if len(self._under_way.plans) > 1:
            self._status.tell(tool=self._under_way.tool, tools=len(self._under_way.plans))

    def _state_of_run(self, data: Mapping[str, object]) -> Mapping[str, object]:
        """Return what a state of the mounted tool means for the run, and note where another tool has its turn."""
        following = self._mounted is not self._under_way
        state = data["state"]
        if state is RunState.COMPLETED and not self._mounted.is_last:
            self._requests.forget_confirmation()
            return {"state": RunState.TOOL_CHANGE, **self._mounted.wanted()}
        if state is RunState.FAULTED and self._report.state is RunState.PREFLIGHT and following:
            return {**data, "state": RunState.TOOL_CHANGE}
        if state is RunState.MOVING_TO_START and following:
            self._under_way, self._before = self._mounted, History()
            self._report("tool", {"tool": self._mounted.tool})
            self._show_tool()
            self._status.tell(place=None, sent=0, executed=0, total=len(self._mounted.plan.program), progress=0.0)
        return data

    def _look_again(self) -> None:
        """Try for a while to reach a controller that was lost: its stamps still know what the host does not."""
        deadline = time.monotonic() + LOOK_AGAIN_S
        self._journal.flush(FLUSH_S)
        while time.monotonic() < deadline and not self._requests.abort.wait(LOOK_EVERY_S):
            try:
                recover_own(self._folder)
            except ControllerError as error:
                _log.warning("the controller is still lost: %s", error)
            else:
                self._status.tell(gate="closed")
                return

    def _tell(self, kind: str, data: Mapping[str, object]) -> None:
        """Pass on what the run reports; what has led to a new state or a new leg is recorded before it."""
        if kind == "state":
            data = self._state_of_run(data)
        if kind in ("state", "leg"):
            self._wire.flush()
        self._report(kind, data)

    def _take(self, act: Act) -> None:
        """Do at once what somebody asks for; noted is it afterwards."""
        try:
            ask(self._requests, act)
        except (KeyError, TypeError, ValueError) as error:
            self._refuse(f"{act}: {error!r}")
        self._report("act", act, act.get("key"))

    def _refuse(self, what: str) -> None:
        self._report("fault", {"code": "act", "message": f"refused: {what}"})

    def _end(self, error: IbfctlError) -> None:
        """Note what kept the run from going on; one that was to be resumed can still be."""
        told = {"code": error.code, "reason": error.message, "hint": error.hint}
        if self._report.at_rest:
            self._report("fault", {**told, "message": error.message})
        else:
            state = RunState(end_of(error).value)
            lost = state is RunState.FAULTED and self._report.state is RunState.RESUMING
            self._report("state", {"state": RunState.INTERRUPTED if lost else state, **told})


def ask(requests: Requests, act: Act) -> None:
    """Pass an act on.

    Raises
    ------
    KeyError, TypeError, ValueError
        If there is no such act, or it lacks something.
    """
    match act["act"]:
        case "pause":
            requests.pause(When(act.get("when", When.SAFE_POINT)))
        case "resume":
            requests.resume()
        case "stop":
            requests.stop()
        case "abort":
            requests.abort.set()
        case "estop":
            requests.estop()
        case "confirm":
            requests.confirm()
        case "interlock":
            requests.interlock(str(act["name"]), float(act["value"]))
        case other:
            raise ValueError(f"no act {other!r}")


if __name__ == "__main__":
    sys.exit(main())
