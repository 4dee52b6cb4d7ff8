"""Everything that is checked before an axis moves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ibfctl.errors import ControllerError, LimitsError, RunError
from ibfctl.machine.controller import MotionController
from ibfctl.machine.description import MachineDescription
from ibfctl.machine.program import MAX_SEGMENT_SAMPLES, AxisProgram, ContourAxis, MotionProgram

PERIOD_TOLERANCE = 1e-4
MEASURE_S = (0.25, 1.0, 4.0, 16.0)
"""Late or jittery replies may spoil a short measurement, so a doubtful one is repeated with more patience."""

SPEED_SLACK = 1.001
TRAVEL_SLACK_COUNTS = 0.5
"""What rounding to counts may add to a plan that keeps its limits."""

DOUBTFUL, AGREEMENT = 50 * PERIOD_TOLERANCE, 0.1
"""A larger deviation ends the search where two measurements agree on it, to that share."""


def check_program(program: MotionProgram, machine: MachineDescription) -> None:
    """Refuse a program that was not made for this machine, or that leaves its travel.

    Raises
    ------
    RunError
        If program and machine do not belong together.
    LimitsError
        If the motion leaves an axis' travel, is faster than the axis may be, does not end at rest, or holds an
        impossible duration.
    """
    times = program.time_samples
    if len(program) == 0 or np.any((times < 2) | (times > MAX_SEGMENT_SAMPLES) | (times % 2 != 0)):
        raise LimitsError("program: segment times must be even, from 2 to 2048 samples", "plan the job again")
    coordinates = {letter: coordinate for coordinate, letter in program.coordinates.items()}
    if not coordinates.keys() == program.axes.keys() == machine.axes.keys():
        raise _mismatch(f"axes {''.join(program.axes)}", f"{''.join(machine.axes)}")
    if not np.isclose(program.sample_period_s, machine.sample_period_s, rtol=1e-9, atol=0):
        raise _mismatch(f"sample period {program.sample_period_s:g} s", f"{machine.sample_period_s:g} s")
    for letter, limits in machine.axes.items():
        coordinate, axis = coordinates[letter], program.axes[letter]
        if coordinate != limits.coordinate or axis.counts_per_mm != limits.signed_counts_per_mm:
            raise _mismatch(
                f"axis {letter}: {coordinate}, {axis.counts_per_mm:g} counts/mm",
                f"{limits.coordinate}, {limits.signed_counts_per_mm:g} counts/mm",
            )
        if isinstance(axis, AxisProgram) and axis.end_velocity_counts_s[-1] != 0:
            raise LimitsError(f"program: axis {letter} does not end at rest", "plan the job again")
        extremes_mm = np.sort(_hull_counts(program, axis) / axis.counts_per_mm)
        slack_mm = TRAVEL_SLACK_COUNTS / limits.counts_per_mm
        if extremes_mm[0] < limits.travel_min_mm - slack_mm or extremes_mm[-1] > limits.travel_max_mm + slack_mm:
            raise LimitsError(
                f"program: axis {letter} moves from {extremes_mm[0]:.3f} to {extremes_mm[-1]:.3f} mm, "
                f"beyond its travel from {limits.travel_min_mm:g} to {limits.travel_max_mm:g} mm",
                "move the part or shrink the clear aperture, and plan the job again",
            )
        peak_mm_s = _peak_speed_counts_s(program, axis) / abs(axis.counts_per_mm)
        if peak_mm_s > limits.v_max_mm_s * SPEED_SLACK:
            raise LimitsError(
                f"program: axis {letter} reaches {peak_mm_s:.3f} mm/s, its limit is {limits.v_max_mm_s:g} mm/s",
                "plan the job again for the present machine file",
            )


def _mismatch(planned: str, present: str) -> RunError:
    return RunError(
        f"program was made for another machine: {planned}, here {present}",
        "plan the job for this machine file",
    )


def _hull_counts(program: MotionProgram, axis: AxisProgram | ContourAxis) -> NDArray[np.float64]:
    """Return least and greatest node, or Bernstein coefficient of all cubics; every position lies in between."""
    nodes = axis.start_counts + np.concatenate([[0], np.cumsum(axis.increment_counts)])
    if isinstance(axis, ContourAxis):
        return np.array([nodes.min(), nodes.max()], dtype=np.float64)
    velocities = np.concatenate([[0], axis.end_velocity_counts_s])
    thirds_s = program.time_samples * program.sample_period_s / 3
    inner = np.concatenate([nodes[:-1] + velocities[:-1] * thirds_s, nodes[1:] - velocities[1:] * thirds_s])
    return np.array([min(nodes.min(), inner.min()), max(nodes.max(), inner.max())])


def _peak_speed_counts_s(program: MotionProgram, axis: AxisProgram | ContourAxis) -> float:
    """Return the greatest speed anywhere: at the nodes, or where a segment's acceleration passes zero."""
    times_s = program.time_samples * program.sample_period_s
    means = axis.increment_counts / times_s
    if isinstance(axis, ContourAxis):
        return float(np.max(np.abs(means)))
    ends = axis.end_velocity_counts_s.astype(np.float64)
    starts = np.concatenate([[0.0], ends[:-1]])
    linear, square = 6 * means - 4 * starts - 2 * ends, 3 * (starts + ends - 2 * means)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = -linear / (2 * square)
    inside = np.isfinite(share) & (share > 0) & (share < 1)
    turning = np.where(inside, starts - linear**2 / np.where(inside, 4 * square, 1.0), 0.0)
    return float(np.max(np.abs(np.concatenate([ends, turning]))))


def check_clock(controller: MotionController, sample_period_s: float, time_scale: float) -> float:
    """Measure the controller's sample period and refuse one that differs from the machine file's.

    Parameters
    ----------
    controller
        The connected controller.
    sample_period_s
        What the machine file says.
    time_scale
        Controller seconds per host second: 1, but for an emulated clock.

    Returns
    -------
    float
        The period measured, in controller seconds.

    Raises
    ------
    ControllerError
        If it differs by more than 1e-4: everything would last, and remove, too much or too little.
    """
    measured_s = 0.0
    for duration_s in MEASURE_S:
        before_s, measured_s = measured_s, controller.measure_sample_period_s(duration_s) * time_scale
        deviation = measured_s / sample_period_s - 1
        if abs(deviation) <= PERIOD_TOLERANCE:
            return measured_s
        # A reply that was late makes one measurement wrong, and not two of them alike.
        if abs(deviation) > DOUBTFUL and abs(measured_s - before_s) < AGREEMENT * abs(deviation) * sample_period_s:
            break
    raise ControllerError(
        f"a sample of the controller lasts {measured_s * 1e6:.3f} us, "
        f"the machine file says {sample_period_s * 1e6:.3f} us",
        "set TM on the controller, or sample_period_s in the machine file and plan again",
    )
