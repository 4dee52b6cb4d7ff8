"""Preflight: everything that must hold before an axis moves, each with a name that an operator can be shown."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ibfctl.errors import ControllerError, IbfctlError, LimitsError, RunError
from ibfctl.machine.program import PvtProgram
from ibfctl.path.tool_path import ToolPath
from ibfctl.planning.job import corridor_of
from ibfctl.planning.plan import Plan
from ibfctl.runs.limits import position_range
from ibfctl.runs.nodes import Nodes
from ibfctl.runs.preflight import check_clock, check_program
from ibfctl.runs.rig import Rig
from ibfctl.schedule.certificate import certify

ALONE = "alone"
"""Name of the check that nobody else uses the controller."""

NODE_COUNTS = 0.5 + 1e-6
LEAST_FREE_BYTES = 200_000_000
BYTES_PER_SAMPLE = 40
"""A row of the run file, with room to spare."""


@dataclass(frozen=True)
class PreflightCheck:
    """One check of the list that an operator sees.

    Attributes
    ----------
    name
        What was looked at, e.g. ``travel``.
    ok
        Whether it is as it should be.
    message
        What was found, or what is wrong and what to do about it.
    """

    name: str
    ok: bool
    message: str


def preflight(plan: Plan, rig: Rig, folder: Path | None) -> Iterator[PreflightCheck]:
    """Make the checks one by one; the gate is closed, and nothing moves.

    Whoever finds somebody else's run on the controller leaves it alone: the list ends there. The servos are switched on
    last, and only if all else is well.

    Parameters
    ----------
    plan, rig
        What is to run, on what.
    folder
        Where the run is recorded; None where it is not.

    Raises
    ------
    RunError
        If the run was aborted or stopped meanwhile.
    """
    checks: list[tuple[str, Callable[[], str]]] = [
        (ALONE, lambda: _alone(rig)),
        ("gate", lambda: _gate(rig)),
        ("certificate", lambda: _certificate(plan)),
        ("program", lambda: _program(plan, rig)),
        ("controller", lambda: rig.controller.identify().model),
        ("emergency stop", lambda: _latch(rig)),
        ("guard", lambda: _guard(rig)),
        ("clock", lambda: _clock(rig)),
        ("homed", lambda: _homed(rig)),
        ("soft limits", lambda: _soft_limits(plan, rig)),
        ("disk", lambda: _disk(plan, folder)),
        ("motors", lambda: _motors(rig)),
    ]
    all_well = True
    for name, look in checks:
        rig.sentinel.check()
        if name == "motors" and not all_well:
            return
        check = _made(name, look)
        yield check
        all_well = all_well and check.ok
        if name == ALONE and not check.ok:
            return


def _made(name: str, look: Callable[[], str]) -> PreflightCheck:
    try:
        return PreflightCheck(name, True, look())
    except IbfctlError as error:
        return PreflightCheck(name, False, str(error))


def _alone(rig: Rig) -> str:
    age_s = rig.controller.guard_owner_age_s()
    if age_s is not None and age_s <= rig.patience_s:
        raise RunError(
            f"somebody else's guard runs on the controller, and heard of its host {age_s:.1f} s ago",
            "wait for the other run, or end it",
        )
    return "nobody else's run is on the controller"


def _certificate(plan: Plan) -> str:
    """Make the certificate anew from the integers; what the plan was certified for must still hold."""
    program, machine = plan.program, plan.machine
    if not plan.certificate.passed:
        raise LimitsError("the plan has no certificate that passed", "plan the job again")
    place_mm = {
        coordinate: Nodes.of(program).position_counts[letter] / program.axes[letter].counts_per_mm
        for coordinate, letter in program.coordinates.items()
    }
    pieces = ToolPath(place_mm["x"], place_mm["y"])
    anew = certify(
        program, machine, pieces, program.time_s, np.arange(len(program)), corridor_of(plan.options)
    ).checks
    names = {check.name for check in plan.certificate.checks}
    for check in anew:
        if check.name in names and not check.passed:
            raise LimitsError(f"{check.name} is {check.value:g}, its limit {check.limit:g}", "plan the job again")
    if not _visits(program, plan):
        raise LimitsError("the program does not visit every node of the plan's path", "plan the job again")
    return f"{len(names)} checks pass anew"


def _visits(program: PvtProgram, plan: Plan) -> bool:
    """Whether the program's nodes hold those of the path in their order, to half a count."""
    path = {"x": plan.stage_path.x_mm, "y": plan.stage_path.y_mm}
    nodes = Nodes.of(program)
    wanted = {letter: path[c] * program.axes[letter].counts_per_mm for c, letter in program.coordinates.items()}
    found, count = 0, plan.stage_path.segments + 1
    for place in zip(*(nodes.position_counts[letter] for letter in wanted), strict=True):
        if found < count and all(
            abs(counts - values[found]) <= NODE_COUNTS for counts, values in zip(place, wanted.values(), strict=True)
        ):
            found += 1
    return found == count


def _program(plan: Plan, rig: Rig) -> str:
    check_program(plan.program, rig.machine)
    return f"{len(plan.program)} segments in {plan.program.total_time_s:.1f} s within speed and travel"


def _gate(rig: Rig) -> str:
    rig.close_gate_timed()
    return "closed, and reads closed"


def _latch(rig: Rig) -> str:
    if rig.controller.latched():
        raise RunError(
            "an emergency stop is latched", "make the machine safe, switch the controller off and on, and home it"
        )
    return "not latched"


def _guard(rig: Rig) -> str:
    rig.controller.start_guard(rig.patience_s)
    rig.controller.stop_guard()
    return "loaded, reads back, and runs"


def _clock(rig: Rig) -> str:
    period_s = check_clock(rig.controller, rig.machine.sample_period_s, rig.time_scale)
    return f"a sample lasts {period_s * 1e6:.2f} us"


def _homed(rig: Rig) -> str:
    lost = [letter for letter, known in rig.controller.homed().items() if not known]
    if lost:
        raise RunError(f"axis {' and '.join(lost)} was not homed in this power cycle", "home the machine first")
    return "every axis knows where it is"


def _soft_limits(plan: Plan, rig: Rig) -> str:
    cubics = Nodes.of(plan.program).cubics(plan.program.sample_period_s)
    for letter, (least, greatest) in rig.controller.soft_limits().items():
        low, high = position_range(cubics[letter])
        if low < least or high > greatest:
            raise LimitsError(
                f"axis {letter} moves from {low:.0f} to {high:.0f} counts, beyond the controller's soft limits "
                f"{least} to {greatest}",
                "set BL and FL on the controller, or move the part",
            )
    return "the motion stays within FL and BL"


def _motors(rig: Rig) -> str:
    rig.controller.servo_on()
    for letter, axis in rig.controller.status().items():
        if axis.moving or not axis.motor_on:
            raise ControllerError(f"axis {letter} {'moves' if axis.moving else 'is off'}", "see who else is connected")
    return "on, and at rest"


def _disk(plan: Plan, folder: Path | None) -> str:
    if folder is None:
        return "nothing is recorded"
    needed = LEAST_FREE_BYTES + BYTES_PER_SAMPLE * int(plan.program.time_samples.sum())
    free = shutil.disk_usage(folder).free
    if free < needed:
        raise RunError(
            f"{folder}: {free / 1e6:.0f} MB free, the record of this run may need {needed / 1e6:.0f} MB", "make room"
        )
    return f"{free / 1e9:.1f} GB free"
