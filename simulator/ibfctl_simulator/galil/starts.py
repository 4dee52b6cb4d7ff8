"""How motions begin: independent moves, jogs, tracking, PVT, contour, homing."""

from __future__ import annotations

import math
from collections.abc import Callable

from ibfctl_simulator.galil import errors
from ibfctl_simulator.galil.axis import MOVING, Axis, Mode
from ibfctl_simulator.galil.contour import RUNNING as CONTOURING
from ibfctl_simulator.galil.contour import ContourProfile, ContourQueue
from ibfctl_simulator.galil.errors import CommandError
from ibfctl_simulator.galil.phases import jog_phases, move_phases
from ibfctl_simulator.galil.profiles import FloatArray
from ibfctl_simulator.galil.pvt import RUNNING as PVT_RUNNING
from ibfctl_simulator.galil.pvt import PvtProfile
from ibfctl_simulator.galil.switches import Direction, first_true

EDGE_FOUND, HOMED = 9, 10


def set_target(axis: Axis, name: str, counts: float) -> None:
    """Set `PA`, `PR` or `JG` and choose the kind of the next move; some take effect at once."""
    if name == "JG" and axis.mode == "jog" and not axis.stopping:
        axis.parameters["JG"] = counts
        start_jog(axis)
        return
    if name == "JG" and axis.profile is not None:
        raise CommandError(errors.NOT_JOGGING)
    if name == "PA" and axis.parameters["PT"]:
        axis.parameters["PA"] = counts
        _track(axis)
        return
    axis.require_still()
    axis.parameters[name] = counts
    if name == "PA":
        axis.target = "PA"
    else:
        axis.target = "PR" if name == "PR" else "JG"


def check_begin(axis: Axis) -> None:
    """Raise the error that a `BG` on this axis would give."""
    if not axis.motor_on:
        raise CommandError(errors.MOTOR_OFF)
    if axis.profile is not None:
        raise CommandError(errors.ALREADY_RUNNING)
    way = _way(axis)
    direction: Direction = "forward" if way > 0 else "reverse"
    if way and axis.limit_enabled(direction) and axis.limit_active(direction):
        raise CommandError(errors.LIMIT_SWITCH)


def begin(axis: Axis) -> None:
    """Start the independent move chosen last; homing is chosen anew each time."""
    if axis.target == "JG":
        start_jog(axis)
    elif axis.target in ("FE", "HM"):
        _find_edge(axis, then_index=axis.target == "HM")
        axis.target = "PA"
    elif axis.target == "FI":
        _find_index(axis, axis.parameters["JG"], "index")
        axis.target = "PA"
    else:
        distance = _distance(axis)
        end = axis.commanded_counts + distance
        mode: Mode = "absolute" if axis.target == "PA" else "relative"
        axis.run_phases(_move(axis, distance), mode, end_counts=float(round(end)))


def start_jog(axis: Axis) -> None:
    """Go to the jog velocity from the present one."""
    parameters = axis.parameters
    phases = jog_phases(axis.velocity_counts_s, parameters["JG"], parameters["AC"], parameters["DC"])
    axis.run_phases(phases, "jog")


def check_begin_pvt(axis: Axis) -> None:
    """Raise the error that a `BT` on this axis would give."""
    if not axis.motor_on:
        raise CommandError(axis.settings.begin_motor_off_error)
    if axis.profile is not None:
        raise CommandError(axis.settings.begin_running_error)
    if not axis.buffer.waiting and axis.settings.begin_empty_error:
        raise CommandError(axis.settings.begin_empty_error)


def begin_pvt(axis: Axis) -> None:
    """Start executing the buffered segments with the next sample."""
    axis.run(PvtProfile(axis.buffer, axis.commanded_counts, axis.sample_period_s), "pvt", PVT_RUNNING)


def begin_contour(axis: Axis, index: int, queue: ContourQueue) -> None:
    """Enter contour mode; records are followed as soon as there are any."""
    profile = ContourProfile(queue, index, axis.commanded_counts, axis.sample_period_s)
    axis.run(profile, "contour", CONTOURING)


def _way(axis: Axis) -> float:
    if axis.target in ("JG", "FI"):
        return axis.parameters["JG"]
    if axis.target in ("FE", "HM"):
        return _edge_way(axis)
    return _distance(axis)


def _distance(axis: Axis) -> float:
    if axis.target == "PR":
        return axis.parameters["PR"]
    return axis.parameters["PA"] - axis.commanded_counts


def _move(axis: Axis, distance: float) -> list[tuple[float, float]]:
    parameters = axis.parameters
    speed = parameters["SP"]
    if speed == 0.0:  # begins, and gets nowhere until it is stopped
        return [(math.inf, 0.0)]
    return move_phases(distance, axis.velocity_counts_s, speed, parameters["AC"], parameters["DC"])


def _track(axis: Axis) -> None:
    """Head for the new absolute target from the present state of motion."""
    if not axis.motor_on:
        raise CommandError(errors.MOTOR_OFF)
    target = axis.parameters["PA"]
    phases = _move(axis, target - axis.commanded_counts)
    axis.run_phases(phases, "tracking", end_counts=target)


def _edge_way(axis: Axis) -> float:
    """Towards the home switch's edge: forward while it is inactive, reverse while it is active."""
    return -1.0 if axis.switches.home_at(axis.physical_counts) else 1.0


def _seek(axis: Axis, velocity: float, search: Callable[[FloatArray, float], int | None]) -> None:
    mode = axis.mode
    phases = jog_phases(0.0, velocity, axis.parameters["AC"], axis.parameters["DC"])
    axis.run_phases(phases, mode, MOVING)
    axis.search = search


def _find_edge(axis: Axis, *, then_index: bool) -> None:
    """`FE` and the first stage of `HM`: run to the edge of the home switch, then decelerate."""
    way = _edge_way(axis)
    axis.mode = "home" if then_index else "edge"

    def stopped() -> None:
        axis.mode = "home"
        _return_to_edge(axis, -way)
        axis.home_phase = 1

    def found() -> None:
        axis.stop(EDGE_FOUND)
        if then_index:
            axis.on_stopped(stopped)

    _seek(axis, way * axis.parameters["SP"], _home_edge(axis))
    axis.on_found = found


def _return_to_edge(axis: Axis, way: float) -> None:
    """Second stage of `HM`: back to the edge at `HV`, stopping on it."""

    def found() -> None:
        axis.stop(HOMED, at_once=True)
        _find_index(axis, axis.parameters["HV"], "home")

    _seek(axis, way * axis.parameters["HV"], _home_edge(axis))
    axis.on_found = found


def _find_index(axis: Axis, velocity: float, mode: Mode) -> None:
    """`FI` and the last stage of `HM`: run to the index pulse, stop there and call it zero."""

    def found() -> None:
        axis.stop(HOMED, at_once=True)
        axis.shift_origin(axis.reference_counts)

    axis.mode = mode
    _seek(axis, velocity, lambda physical, before: first_true(axis.switches.index_passed(before, physical)))
    axis.home_phase = 2
    axis.on_found = found


def _home_edge(axis: Axis) -> Callable[[FloatArray, float], int | None]:
    before = axis.switches.home_at(axis.physical_counts)
    return lambda physical, _: first_true(axis.switches.home(physical) != before)
