"""Shortest and longest time of every step of a path: what the machine and the user's slowest speed allow."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ibfctl.dwell.bounds import ADVISED_SHARES, DwellBounds, SpeedRamp, characteristic_speed_mm_s, dwell_bounds
from ibfctl.errors import InputError, LimitsError
from ibfctl.machine.description import MachineDescription
from ibfctl.path.tool_path import ToolPath
from ibfctl.planning.options import PlanOptions
from ibfctl.schedule.scheduler import shortest_times

FloatArray = NDArray[np.float64]

# Relative to a pair of samples.
_ROUNDING = 1e-6


def step_bounds(path: ToolPath, machine: MachineDescription, options: PlanOptions) -> DwellBounds:
    """Bounds (n,) of the dwell times of a path, whole pairs of samples: rounding times within them keeps them.

    Lower bounds are never below the shortest times of the machine. With a slowest speed v the upper bound of a step s
    is s/v; bounds of the kind "ramp" are those of Zhang et al. 2021 (Int. J. Precis. Eng. Manuf.-Green Tech. 8,
    Eq. 17), for the acceleration that the weaker axis allows along every step and a top speed of at most 0.8 of the
    characteristic speed (Eq. 20).

    Raises
    ------
    InputError
        If a choice is no time or no speed, or a slowest speed is missing.
    LimitsError
        If a step must take longer than it may.
    """
    pair_s = 2 * machine.sample_period_s
    lower_s, upper_s = shortest_times(path, machine), np.full(path.segments, np.inf)
    if options.dwell_min_s is not None:
        if not (np.isfinite(options.dwell_min_s) and options.dwell_min_s >= 0):
            raise InputError(f"dwell_min_s is {options.dwell_min_s:g}", "give a time of zero or more seconds")
        lower_s = np.maximum(lower_s, options.dwell_min_s)
    slowest = options.v_min_mm_s
    if slowest is not None:
        if not 0 < slowest < np.inf:
            raise InputError(f"v_min_mm_s is {slowest:g}", "give a speed above zero")
        upper_s = path.length_mm / slowest
    if options.dwell_bounds == "ramp":
        if slowest is None:
            raise InputError("dwell bounds of a ramp need the slowest speed", "give --v-min-mm-s")
        ramp = _ramp_bounds(path, machine, slowest)
        lower_s, upper_s = np.maximum(lower_s, ramp.lower_s), np.minimum(upper_s, ramp.upper_s)
    lower_s = pair_s * np.ceil(lower_s / pair_s - _ROUNDING)
    upper_s = pair_s * np.floor(upper_s / pair_s + _ROUNDING)
    _check_possible(path, lower_s, upper_s, options)
    return DwellBounds(lower_s, upper_s)


def along_path(path: ToolPath, machine: MachineDescription) -> tuple[FloatArray, FloatArray]:
    """Speeds and accelerations (n,) that the weaker axis allows along each step; infinite where nothing moves."""
    speed, push = np.full(path.segments, np.inf), np.full(path.segments, np.inf)
    for coordinate, nodes_mm in (("x", path.x_mm), ("y", path.y_mm)):
        axis, move_mm = machine.axis_of(coordinate), np.abs(np.diff(nodes_mm))
        share = np.divide(path.length_mm, move_mm, out=np.full(path.segments, np.inf), where=move_mm > 0)
        speed, push = np.minimum(speed, axis.v_max_mm_s * share), np.minimum(push, axis.a_max_mm_s2 * share)
    return speed, push


def _ramp_bounds(path: ToolPath, machine: MachineDescription, slowest_mm_s: float) -> DwellBounds:
    """Bounds (n,) of linear ramps between one slowest and one fastest speed; none where nothing moves."""
    moving = path.length_mm > 0
    lower_s, upper_s = np.zeros(path.segments), np.full(path.segments, np.inf)
    if moving.any():
        step_mm = path.length_mm[moving]
        speed, push = (values[moving] for values in along_path(path, machine))
        characteristic = float(characteristic_speed_mm_s(step_mm, push, 0.0).min())
        ramp = SpeedRamp(slowest_mm_s, min(float(speed.min()), ADVISED_SHARES[1] * characteristic), float(push.min()))
        bounds = dwell_bounds(step_mm, ramp)
        lower_s[moving], upper_s[moving] = bounds.lower_s, bounds.upper_s
    return DwellBounds(lower_s, upper_s)


def _check_possible(path: ToolPath, lower_s: FloatArray, upper_s: FloatArray, options: PlanOptions) -> None:
    impossible = upper_s < lower_s
    if impossible.any():
        worst = int(np.argmax(lower_s - upper_s))
        raise LimitsError(
            f"dwell bounds: the step to node {worst + 1} ({path.x_mm[worst + 1]:.3f}, {path.y_mm[worst + 1]:.3f} mm; "
            f"{path.length_mm[worst]:.3g} mm long) takes at least {lower_s[worst]:.4g} s, but at "
            f"{options.v_min_mm_s:g} mm/s or more at most {upper_s[worst]:.4g} s "
            f"({int(impossible.sum())} of {path.segments} steps cannot be)",
            "lower --v-min-mm-s, take longer steps, or leave out repeated nodes",
        )
