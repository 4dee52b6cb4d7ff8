"""Trapezoids as phases of constant acceleration: (duration in s, signed acceleration in counts/s^2)."""

from __future__ import annotations

import math


def move_phases(
    distance: float, velocity: float, speed: float, acceleration: float, deceleration: float
) -> list[tuple[float, float]]:
    """Phases of a trapezoidal move over `distance` counts that ends at rest.

    Parameters
    ----------
    distance : signed distance to the target in counts
    velocity : signed velocity at the start in counts/s
    speed, acceleration, deceleration : positive limits

    Returns
    -------
    list of (duration in s, signed acceleration). A start velocity that leads away from the target,
    or too fast to stop in time, is first brought to rest.
    """
    stop_distance = velocity * abs(velocity) / (2.0 * deceleration)
    direction = 1.0 if distance >= 0 else -1.0
    if velocity * direction < 0 or abs(stop_distance) > abs(distance):
        rest = move_phases(distance - stop_distance, 0.0, speed, acceleration, deceleration)
        return [(abs(velocity) / deceleration, -math.copysign(deceleration, velocity)), *rest]
    start, length = abs(velocity), abs(distance)
    if length == 0.0:
        return []
    if start > speed:
        slowing = (start**2 - speed**2) / (2.0 * deceleration)
        cruise = length - slowing - speed**2 / (2.0 * deceleration)
        ramp = ((start - speed) / deceleration, -deceleration)
        peak = speed
    else:
        # Speed at which accelerating from `start` must turn into braking to stop at the target.
        work = 2.0 * acceleration * deceleration * length + deceleration * start**2
        peak = min(speed, math.sqrt(work / (acceleration + deceleration)))
        ramp = ((peak - start) / acceleration, acceleration)
        ramps = (peak**2 - start**2) / (2.0 * acceleration) + peak**2 / (2.0 * deceleration)
        cruise = max(0.0, length - ramps)
    phases = [ramp, (cruise / peak, 0.0), (peak / deceleration, -deceleration)]
    return [(duration, direction * rate) for duration, rate in phases if duration > 0.0]


def jog_phases(
    velocity: float, target: float, acceleration: float, deceleration: float
) -> list[tuple[float, float]]:
    """Phases from `velocity` to the jog velocity `target` (counts/s), held for ever after."""
    phases: list[tuple[float, float]] = []
    if velocity * target < 0.0:
        phases.append((abs(velocity) / deceleration, -math.copysign(deceleration, velocity)))
        velocity = 0.0
    rate = acceleration if abs(target) >= abs(velocity) else deceleration
    if target != velocity:
        phases.append((abs(target - velocity) / rate, math.copysign(rate, target - velocity)))
    return [*phases, (math.inf, 0.0)]


def stop_phases(velocity: float, deceleration: float) -> list[tuple[float, float]]:
    """Phases from `velocity` to rest."""
    return [(abs(velocity) / deceleration, -math.copysign(deceleration, velocity))] if velocity else []
