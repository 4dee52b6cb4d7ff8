"""Carry out one leg: to its start, fill, open the gate, begin, feed, end, and prove what was executed."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Mapping
from dataclasses import replace

from ibfctl.errors import ControllerError, IbfctlError, RunError
from ibfctl.machine.controller import Stamps
from ibfctl.runs.feeder import Feeder
from ibfctl.runs.leg import Leg, LegEnd, LegOutcome, end_of
from ibfctl.runs.outcome import RunProgress
from ibfctl.runs.polls import Polls
from ibfctl.runs.rig import Rig
from ibfctl.runs.states import RunState

HOLD_S = 0.1
GUARD_LOOKS = 0.02
"""Share of its patience after which the guard has surely looked again."""

_log = logging.getLogger(__name__)


def execute_leg(
    leg: Leg,
    rig: Rig,
    *,
    on_progress: Callable[[RunProgress], None] = lambda _: None,
    on_state: Callable[[RunState], None] = lambda _: None,
) -> LegOutcome:
    """Carry out a leg, and leave the gate closed and the axes at rest whatever happens.

    Parameters
    ----------
    leg
        What to execute.
    rig
        On what; the sentinel must watch already.
    on_progress
        Called in this thread about ten times a second while the axes move.
    on_state
        Called when the leg gets to `ARMED`, `RUNNING`, `PAUSING` and `FINISHING`.

    Returns
    -------
    LegOutcome
        Also where the leg failed once the axes had begun to move, or on the way there; its `error` says so.

    Raises
    ------
    KeyboardInterrupt
        And whatever else is no error; the gate is closed and the axes are at rest all the same.
    """
    work = _Work(leg, rig, on_progress, on_state)
    try:
        return work.execute()
    except BaseException as error:
        rig.sentinel.relax()
        trouble = rig.make_safe()
        if not isinstance(error, Exception):
            raise
        told = rig.sentinel.error() or work.explained(error)
        if trouble:
            told = RunError(f"{told}; {trouble}", "switch the beam off by hand now")
        if told is not error:
            told.__cause__ = error
        return work.outcome(end_of(told), told, {}, {})


class _Work:
    """The steps of one leg, in the streaming thread."""

    def __init__(
        self, leg: Leg, rig: Rig, on_progress: Callable[[RunProgress], None], on_state: Callable[[RunState], None]
    ) -> None:
        self._leg = leg
        self._rig = rig
        self._controller = rig.controller
        self._on_state = on_state
        self._feeder = Feeder(leg, rig, on_progress, lambda: on_state(RunState.PAUSING))
        self._tolerance_counts = rig.machine.servo.position_tolerance_counts
        self._began = False

    def execute(self) -> LegOutcome:
        """Take all steps in order."""
        self._approach()
        with self._rig.on_guard():
            self._fill()
            self._on_state(RunState.ARMED)
            self._hold()
            self._rig.expect_prompt_replies()
            self._began = True
            self._feeder.begin()
            self._on_state(RunState.RUNNING)
            self._feeder.run()
            self._controller.close_gate()
        self._feeder.report()
        errors = self._prove()
        self._controller.stop_guard()
        codes = dict.fromkeys(errors, self._feeder.leg.program.COMPLETE_CODE)
        outcome = self.outcome(LegEnd.COMPLETED, None, codes, errors)
        if self._feeder.paused:
            return replace(outcome, end=LegEnd.PAUSED)
        last = int(self._leg.ends_samples[-1]) + self._leg.shift_samples
        if outcome.open_plan_samples is not None and outcome.open_plan_samples[1] == last:
            return outcome
        if self._rig.sentinel.gate_shut.is_set():
            return replace(outcome, end=LegEnd.PAUSED)
        raise RunError(
            "the gate was not open up to the end of the motion", "see who else is connected, and measure the part"
        )

    def outcome(
        self, end: LegEnd, error: IbfctlError | None, codes: Mapping[str, int], errors: Mapping[str, int]
    ) -> LegOutcome:
        """Say what became of the leg, as far as the controller still tells."""
        stamps = self._stamps() if self._began else None
        polls = self._feeder.log.polls()
        opened, uncertainty = self._open_plan_samples(stamps, polls)
        ledger = self._feeder.ledger
        return LegOutcome(
            leg=self._feeder.leg,
            end=end,
            error=error,
            open_plan_samples=opened,
            uncertainty_samples=uncertainty,
            sent=ledger.sent,
            executed=ledger.executed,
            minimum_margin_s=ledger.minimum_margin_s,
            stop_codes=codes,
            position_error_counts=errors,
            begun_samples=self._feeder.began_samples,
            polls=polls,
        )

    def explained(self, error: Exception) -> IbfctlError:
        """Say how far the leg had come when the controller, or this program, failed it."""
        if not isinstance(error, IbfctlError):
            _log.error("a leg failed", exc_info=error)
            error = RunError(f"the program failed: {error!r}", "this is a defect: keep the log and report it")
        if not self._began or end_of(error) is not LegEnd.FAULTED:
            return error
        done = f"run ended after {self._feeder.ledger.executed} of {len(self._leg.program)} segments"
        return RunError(f"{done}: {error.message}", error.hint)

    def _approach(self) -> None:
        self._rig.sentinel.check()
        self._controller.servo_on()
        self._controller.move_to({letter: axis.start_counts for letter, axis in self._leg.program.axes.items()})

    def _fill(self) -> None:
        self._controller.prepare_segments(self._leg.program)
        places = self._controller.buffer_places
        while self._feeder.queued < places and not self._feeder.all_sent:
            self._rig.sentinel.check()
            if not self._feeder.send(min(self._controller.buffer_status().free_places.values())):
                break
        if self._feeder.all_sent and self._feeder.queued < places:
            self._controller.buffer_status()
            self._feeder.send_end()
        for letter, free in self._controller.buffer_status().free_places.items():
            if places - free != self._feeder.queued:
                raise ControllerError(f"axis {letter} took {places - free} of {self._feeder.queued} segments")
        for letter, axis in self._controller.status().items():
            error_counts = axis.position_counts - self._leg.program.axes[letter].start_counts
            if not axis.motor_on or abs(error_counts) > self._tolerance_counts:
                raise ControllerError(
                    f"axis {letter} does not stand at its start, but {error_counts} counts away",
                    "check servo tuning and position_tolerance_counts",
                )

    def _hold(self) -> None:
        """Begin nothing while a pause is wanted."""
        while self._rig.requests.pause_wanted is not None:
            self._rig.sentinel.check()
            self._controller.buffer_status()
            self._rig.requests.abort.wait(HOLD_S)
        self._rig.sentinel.check()

    def _prove(self) -> dict[str, int]:
        """Return the position errors at rest, having checked that nothing moves and nothing is missing."""
        program = self._feeder.leg.program
        errors = {}
        executed_segments = self._controller.buffer_status().executed_segments
        for letter, axis in self._controller.status().items():
            errors[letter] = axis.position_counts - program.axes[letter].end_counts
            executed = executed_segments[letter] - 1
            if axis.moving or axis.stop_code != program.COMPLETE_CODE or executed != len(program):
                raise RunError(
                    f"axis {letter} executed {executed} of {len(program)} segments, stop code {axis.stop_code}",
                    "measure the part before planning what is left",
                )
            if abs(errors[letter]) > self._tolerance_counts:
                raise RunError(
                    f"axis {letter} ended {errors[letter]} counts from its end position",
                    "check the stage and its encoder, and measure the part",
                )
        return errors

    def _stamps(self) -> Stamps | None:
        try:
            return self._controller.stamps()
        except ControllerError:
            return None

    def _open_plan_samples(self, stamps: Stamps | None, polls: Polls) -> tuple[tuple[int, int] | None, int]:
        """Return where in the plan the gate was open, and by how much the closing may have been later.

        Without stamps the gate was open from its segment on up to the last poll that has seen it open, and was closed
        by the guard, if not before, when that lost its patience after the last poll of all.
        """
        if not self._began or (stamps is not None and stamps.begun is None):
            return None, 0
        leg, begun = self._feeder.leg, self._feeder.began_samples
        opens = leg.first_plan_sample - leg.shift_samples
        closes = int(leg.ends_samples[self._feeder.close_at])
        if stamps is not None and stamps.begun is not None:
            if stamps.opened is None:
                return None, 0
            closed = closes if stamps.closed is None else min(stamps.closed - stamps.begun, closes)
            return (stamps.opened - stamps.begun + leg.shift_samples, closed + leg.shift_samples), 0
        unheard_s = (1 + GUARD_LOOKS) * self._rig.patience_s + polls.unanswered_s * self._rig.time_scale
        polled = int(polls.time_samples[-1]) - begun if begun and polls.time_samples.size else 0
        latest = min(polled + math.ceil(unheard_s / leg.program.sample_period_s), closes)
        seen = max(min(polls.open_samples - begun, closes) if begun else 0, opens)
        if latest <= opens:
            return None, 0
        return (opens + leg.shift_samples, seen + leg.shift_samples), max(latest - seen, 0)
