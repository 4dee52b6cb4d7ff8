"""Position mode: straight to the next dwell point as fast as the limits allow, from rest to rest, and dwell there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ibfctl.machine.description import MachineDescription
from ibfctl.path.tool_path import ToolPath
from ibfctl.schedule.baselines.motion import AxisMotion, Motion

FloatArray = NDArray[np.float64]


def position_mode(path: ToolPath, dwell_s: FloatArray, machine: MachineDescription) -> Motion:
    """Dwell at every dwell point of a path; moving between them costs time of its own.

    Parameters
    ----------
    path
        Nodes in mm; the dwell points lie between them.
    dwell_s : (n,) float64
        Time at each dwell point.
    machine
        Its limits of velocity and acceleration.

    Returns
    -------
    Motion
        Along the straight lines between dwell points. The first dwell comes before the first move.
    """
    x_mm, y_mm = path.dwell_x_mm, path.dwell_y_mm
    # The first dwell point stands for the start: a move of no length, then the dwell.
    way = ToolPath(np.concatenate([x_mm[:1], x_mm]), np.concatenate([y_mm[:1], y_mm]))
    length = way.length_mm
    moves = np.stack([np.diff(way.x_mm), np.diff(way.y_mm)])
    direction = np.divide(moves, length, out=np.zeros_like(moves), where=length > 0)
    axes = machine.axis_of("x"), machine.axis_of("y")
    with np.errstate(divide="ignore"):
        v_max = np.min([axis.v_max_mm_s / np.abs(part) for axis, part in zip(axes, direction, strict=True)], axis=0)
        a_max = np.min([axis.a_max_mm_s2 / np.abs(part) for axis, part in zip(axes, direction, strict=True)], axis=0)
    moving = length > 0
    v_max, a_max = np.where(moving, v_max, 1.0), np.where(moving, a_max, 1.0)
    peak = np.minimum(v_max, np.sqrt(a_max * length))
    rising_s = peak / a_max
    cruising_s = np.divide(length, peak, out=np.zeros_like(length), where=moving) - np.where(moving, rising_s, 0.0)
    time_s = np.stack([rising_s, np.maximum(cruising_s, 0.0), rising_s, dwell_s], axis=1)
    zero = np.zeros_like(length)
    acceleration = np.stack([a_max * moving, zero, -a_max * moving, zero], axis=1)
    velocity = np.stack([zero, peak, peak, zero], axis=1)
    risen = 0.5 * peak * rising_s
    travelled = np.stack([zero, risen, length - risen, length], axis=1)
    lasting = time_s > 0
    segment = np.repeat(np.arange(length.size), 4).reshape(-1, 4)[lasting]

    def axis(start_mm: FloatArray, part: FloatArray) -> AxisMotion:
        place = start_mm[:, None] + travelled * part[:, None]
        return AxisMotion(
            segment,
            time_s[lasting],
            place[lasting],
            (velocity * part[:, None])[lasting],
            (acceleration * part[:, None])[lasting],
            np.zeros(segment.size),
        )

    return Motion(way, axis(way.x_mm[:-1], direction[0]), axis(way.y_mm[:-1], direction[1]))
