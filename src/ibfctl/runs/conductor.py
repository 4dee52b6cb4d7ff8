"""A whole run: preflight, leg after leg with pauses in between, and what is known at the end."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from ibfctl.errors import ControllerError, EstoppedError, IbfctlError, RunError
from ibfctl.machine.controller import MotionController
from ibfctl.machine.description import MachineDescription
from ibfctl.planning.along import residual_along
from ibfctl.planning.plan import Plan
from ibfctl.runs.as_run import duration_of, trace_of
from ibfctl.runs.checks import ALONE, PreflightCheck, preflight
from ibfctl.runs.counts import EMERGENCY, HINTS
from ibfctl.runs.interlocks import Interlocks
from ibfctl.runs.leg import Leg, LegEnd, LegOutcome, end_of
from ibfctl.runs.motion import execute_leg
from ibfctl.runs.outcome import RunProgress
from ibfctl.runs.pulse import Pulse
from ibfctl.runs.requests import Requests
from ibfctl.runs.result import RunResult
from ibfctl.runs.rig import Rig
from ibfctl.runs.seam import SHORTEST_RAMP_SAMPLES
from ibfctl.runs.sentinel import Sentinel
from ibfctl.runs.states import RunState

LOOK_S = 0.1
TIME_BASE_TOLERANCE = 1e-3

Report = Callable[[str, Mapping[str, object]], None]

_ENDS = {
    LegEnd.STOPPED: RunState.STOPPED,
    LegEnd.ABORTED: RunState.ABORTED,
    LegEnd.ESTOPPED: RunState.ESTOPPED,
    LegEnd.FAULTED: RunState.FAULTED,
}


def conduct(
    plan: Plan,
    machine: MachineDescription,
    controller: MotionController,
    requests: Requests,
    report: Report = lambda kind, data: None,
    *,
    time_scale: float = 1.0,
    poll_interval_s: float = 0.05,
    resume_at: int | None = None,
    folder: Path | None = None,
) -> RunResult:
    """Run a plan to whatever end; the gate is closed and the axes are at rest when this returns.

    Parameters
    ----------
    plan, machine, controller
        What, and on what; the controller is connected and stays so.
    requests
        What operators and interlocks want, from any thread.
    report
        Told of everything as ``(kind, data)``: ``state``, ``preflight``, ``leg`` (before it begins, and once it ended),
        ``progress``, ``interlock``, ``fault``. The caller has reported `PREFLIGHT`, or `RESUMING` with a `resume_at`;
        all later states come from here, the last one with ``reason`` and ``hint``.
    time_scale
        Controller seconds per host second: 1, but for an emulated clock.
    poll_interval_s
        Longest pause between two polls of the controller, on the host's clock.
    resume_at
        Where in the plan to take up an interrupted run, in samples from its begin; None for a new one.
    folder
        Where the run is recorded: there must be room.

    Returns
    -------
    RunResult
        Also where the run failed; its `state` and `error` say so.
    """
    run = _Run(plan, machine, requests, report, resume_at)
    with ExitStack() as watches:
        sentinel = watches.enter_context(Sentinel(controller, requests))
        run.rig = Rig(machine, controller, requests, sentinel, time_scale, poll_interval_s)
        watches.enter_context(Pulse(controller, run.rig.guarded))
        try:
            run.interlocks = Interlocks(machine.interlocks, controller, requests, report)
            watches.enter_context(run.interlocks)
            run.take_off(folder)
            run.fly()
        except IbfctlError as error:
            run.end_with(error)
    return run.result()


class _Run:
    """The steps of one run."""

    rig: Rig
    interlocks: Interlocks

    def __init__(
        self,
        plan: Plan,
        machine: MachineDescription,
        requests: Requests,
        report: Report,
        resume_at: int | None,
    ) -> None:
        self._plan = plan
        self._machine = machine
        self._requests = requests
        self._report = report
        self._started = time.monotonic()
        self._state = RunState.PREFLIGHT if resume_at is None else RunState.RESUMING
        self._nodes = np.concatenate([[0], np.cumsum(plan.program.time_samples)])
        self._leg = Leg(plan.program) if resume_at is None else Leg.resumed(plan.program, resume_at, machine)
        self._legs: list[LegOutcome] = []
        self._checks: tuple[PreflightCheck, ...] = ()
        self._along = residual_along(plan)
        self._progress: RunProgress | None = None
        self._error: IbfctlError | None = None

    def take_off(self, folder: Path | None) -> None:
        """Make the preflight."""
        for check in preflight(self._plan, self.rig, folder):
            self._checks += (check,)
        checks = [{"name": check.name, "ok": check.ok, "message": check.message} for check in self._checks]
        self._report("preflight", {"checks": checks})
        wrong = [f"{check.name}: {check.message}" for check in self._checks if not check.ok]
        if wrong:
            raise RunError(f"preflight: {wrong[0]}" + (f" (and {len(wrong) - 1} more)" if wrong[1:] else ""))
        if self.interlocks.bad:
            raise RunError(f"preflight: interlock {self.interlocks.bad[0]!r} is out of its band", "see to it first")

    def fly(self) -> None:
        """Execute legs until the plan is over."""
        if self._state is RunState.PREFLIGHT:
            self._enter(RunState.MOVING_TO_START)
        while True:
            number = len(self._legs)
            told = {"leg": number, "first_plan_sample": self._leg.first_plan_sample, "open_at": self._leg.open_at}
            self._report("leg", {**told, "segments": len(self._leg.program)})
            outcome = execute_leg(self._leg, self.rig, on_progress=self._on_progress, on_state=self._on_state)
            self._legs.append(outcome)
            ended = {"end": outcome.end, "open_plan_samples": outcome.open_plan_samples, "executed": outcome.executed}
            known = {"uncertainty_samples": outcome.uncertainty_samples, "begun_samples": outcome.begun_samples}
            self._report("leg", {**told, **ended, **known})
            if outcome.error is not None:
                raise outcome.error
            if outcome.seam >= self._nodes[-1]:
                break
            self._pause(outcome.seam)
        self._enter(RunState.FINISHING)
        self._check_duration()
        self._enter(RunState.COMPLETED)

    def end_with(self, error: IbfctlError) -> None:
        """Note the end of a run that was not completed; the gate is closed."""
        lost = self._state is RunState.RESUMING or (
            self._state is RunState.PAUSED and isinstance(error, ControllerError)
        )
        ours = any(check.name == ALONE and check.ok for check in self._checks)
        if ours and (not self._legs or self._state is RunState.PAUSED):
            trouble = self.rig.make_safe()
            error = self.rig.sentinel.error() or error
            if trouble:
                error = RunError(f"{error}; {trouble}", "switch the beam off by hand now")
        self._error = error
        state = _ENDS[end_of(error)]
        if lost and state is RunState.FAULTED:  # nothing has moved since the seam: it can be taken up there again
            state = RunState.INTERRUPTED
        told = {"code": error.code, "reason": error.message, "hint": error.hint, "place": self._place()}
        if self.rig.gate is not None:
            told["gate"] = self.rig.gate
        if state in (RunState.FAULTED, RunState.INTERRUPTED):
            self._report("fault", {"code": error.code, "message": error.message, "hint": error.hint, **told})
        self._enter(state, told)

    def result(self) -> RunResult:
        """Return what is known at the end."""
        period_s = self._machine.sample_period_s
        exposed = any(leg.open_plan_samples is not None for leg in self._legs)
        return RunResult(
            state=self._state,
            error=self._error,
            checks=self._checks,
            legs=tuple(self._legs),
            trace=trace_of(self._legs, period_s) if exposed else None,
            duration=duration_of(self._legs, period_s, self.rig.time_scale),
            sample_period_s=period_s,
            wall_s=time.monotonic() - self._started,
        )

    def _pause(self, seam: int) -> None:
        """Wait at rest behind the closed gate until somebody wants to go on; make the leg that does."""
        if self._state is RunState.RUNNING:
            self._enter(RunState.PAUSING)
        self._enter(RunState.PAUSED, {"place": self._place(), "plan_sample": seam})
        self._leg = Leg.resumed(self._plan.program, seam, self._machine)
        while self._requests.pause_wanted is not None or self.interlocks.bad:
            self.rig.sentinel.check()
            for letter, axis in self.rig.controller.status().items():
                if axis.stop_code in EMERGENCY:
                    hint = HINTS[axis.stop_code]
                    raise EstoppedError(f"emergency stop while paused: axis {letter}, code {axis.stop_code}", hint)
                if not axis.motor_on:
                    raise ControllerError(f"axis {letter} lost its servo while paused", "home the machine, then resume")
            self._report("progress", {"interlocks": dict(self.interlocks.values)})
            self._requests.abort.wait(LOOK_S)
        self._enter(RunState.RESUMING)

    def _check_duration(self) -> None:
        duration = duration_of(self._legs, self._machine.sample_period_s, self.rig.time_scale)
        off_s = duration.as_run_s - duration.planned_s
        if abs(off_s) > duration.resolution_s + TIME_BASE_TOLERANCE * duration.planned_s:
            self._report(
                "fault",
                {
                    "code": "time_base",
                    "message": f"{duration.planned_s:.2f} s of motion took {duration.as_run_s:.2f} s",
                    "hint": "the controller's clock is not what it says: measure the part before the next run",
                },
            )

    def _enter(self, state: RunState, more: Mapping[str, object] | None = None) -> None:
        self._state = state
        self._report("state", {"state": state, **(more or {})})

    def _on_state(self, state: RunState) -> None:
        if not (state is RunState.ARMED and self._state is RunState.RESUMING):
            self._enter(state)

    def _on_progress(self, progress: RunProgress) -> None:
        self._progress = progress
        scale, period_s = self.rig.time_scale, self._machine.sample_period_s
        total = int(self._nodes[-1])
        before = len(self._plan.program) - len(self._leg.program)
        told: dict[str, object] = {
            "place": self._place(),
            "sent": min(max(progress.sent + before, 0), len(self._plan.program)),
            "executed": min(max(progress.executed + before, 0), len(self._plan.program)),
            "total": len(self._plan.program),
            "margin_s": progress.margin_s,
            "minimum_margin_s": progress.minimum_margin_s,
            "gate": "open" if progress.gate_open else "closed",
            "progress": min(progress.plan_sample / total, 1.0),
            "eta_s": max(total - progress.plan_sample, 0) * period_s / scale,
            "eta_pause_s": (progress.margin_s + SHORTEST_RAMP_SAMPLES * period_s) / scale,
            "interlocks": dict(self.interlocks.values),
        }
        if self._along is not None:
            told["residual_rms_nm"] = self._along.at(progress.plan_sample)
        self._report("progress", told)

    def _place(self) -> dict[str, object] | None:
        """Say where the tool was last seen."""
        if self._progress is None:
            return None
        sample = self._progress.plan_sample
        segment = int(np.searchsorted(self._nodes, sample, side="right")) - 1
        return {
            "plan_sample": sample,
            "segment": min(segment, len(self._plan.program) - 1),
            "x_mm": self._progress.position_mm["x"],
            "y_mm": self._progress.position_mm["y"],
        }
