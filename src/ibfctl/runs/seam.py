"""Where a run was interrupted and goes on: cut a program, come to rest along it, and get up to speed along it.

A ramp is the program's own motion with its time stretched: plan time passes at the rate w(u) = 3 u² - 2 u³ (or
w(1 - u)) of the ramp's own time u = 0 .. 1, so that the tool stays on the path, rest and full speed join without a
jump of the rate or of its derivative, and half of the ramp's duration is covered in plan time. Where the program is at
its limits there is no room for that; the ramp is then lengthened, or joins the program at a node further off, with the
program's own segments in between. Only integers that keep the machine's limits are ever returned; the program itself
is taken to keep them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ibfctl.machine.description import MachineDescription
from ibfctl.machine.program import IntArray, PvtProgram
from ibfctl.runs.limits import keeps_limits
from ibfctl.runs.nodes import Nodes

FloatArray = NDArray[np.float64]

SHORTEST_RAMP_SAMPLES = 256
LENGTHENINGS = (1, 2, 4, 8, 16)
ACCELERATION_SHARE = 0.5
"""Of an axis' limit, for the ramp alone, before it is lengthened."""
SHORTEST_PIECE_SAMPLES, LONGEST_PIECE_SAMPLES = 16, 128
"""Rounding to counts shows as acceleration in shorter pieces; longer ones leave the path."""
NEAR_SAMPLES = 64
NEAR_NODES = 64


@dataclass(frozen=True)
class RunIn:
    """How to take a program up again.

    Attributes
    ----------
    program
        The run-in with the gate closed, then the rest of the program.
    open_at
        Segments of the run-in: the gate opens when they are over.
    plan_sample
        Where in the program that is: the seam asked for, or an even sample next to it where a cut keeps the limits.
    """

    program: PvtProgram
    open_at: int
    plan_sample: int


@dataclass(frozen=True)
class RampDown:
    """How to leave a program.

    Attributes
    ----------
    program
        The program up to `leave_at`, and the ramp to rest.
    leave_at
        Segments of the program that it still holds.
    """

    program: PvtProgram
    leave_at: int


def cut(program: PvtProgram, plan_sample: int) -> tuple[PvtProgram, int]:
    """Put a node at an even sample, on the cubic to within half a count; return the program and the node's number."""
    nodes, place = Nodes.of(program).with_node(plan_sample, program.sample_period_s)
    return nodes.program_like(program), place


def run_in(program: PvtProgram, plan_sample: int, machine: MachineDescription) -> RunIn:
    """Return the way from rest to a place in the program and on, the gate closed up to there.

    Parameters
    ----------
    program
        Begins and ends at rest.
    plan_sample
        Seam, 0 to the program's length.
    machine
        Limits.
    """
    nodes, seam = _cut_near(Nodes.of(program), plan_sample, program.sample_period_s, machine)
    for join in _outwards(seam, 0):
        for duration in _durations(nodes, join, program.sample_period_s, machine):
            begin = int(nodes.sample[join]) - duration // 2
            if begin < 0:
                break
            ramp = _ramp(nodes, begin, duration, program.sample_period_s, rising=True)
            if keeps_limits(ramp.cubics(program.sample_period_s), machine):
                whole = ramp.then(nodes.part(join, len(nodes)))
                return RunIn(whole.program_like(program), len(ramp) + seam - join, int(nodes.sample[seam]))
    return RunIn(nodes.program_like(program), seam, int(nodes.sample[seam]))


def ramp_down(program: PvtProgram, segment: int, machine: MachineDescription) -> RampDown:
    """Return the program up to `segment`, or a little later, with a ramp to rest along what would have followed."""
    nodes = Nodes.of(program)
    for join in _outwards(segment, len(nodes)):
        for duration in _durations(nodes, join, program.sample_period_s, machine):
            begin = int(nodes.sample[join])
            if begin + duration // 2 > nodes.sample[-1]:
                break
            ramp = _ramp(nodes, begin, duration, program.sample_period_s, rising=False)
            if keeps_limits(ramp.cubics(program.sample_period_s), machine):
                return RampDown(nodes.part(0, join).then(ramp).program_like(program), join)
    return RampDown(program, len(program))


def _cut_near(nodes: Nodes, plan_sample: int, period_s: float, machine: MachineDescription) -> tuple[Nodes, int]:
    """Cut at the even sample next to the seam at which both pieces keep the limits; at worst at a node."""
    total = int(nodes.sample[-1])
    wanted = min(max(plan_sample - plan_sample % 2, 0), total)
    nearest = int(nodes.sample[np.argmin(np.abs(nodes.sample - wanted))])
    furthest = min(abs(nearest - wanted), NEAR_SAMPLES)
    for off in range(0, furthest, 2):
        for sample in (wanted - off, wanted + off):
            made, place = nodes.with_node(sample, period_s)
            if made is nodes or keeps_limits(made.part(place - 1, place + 1).cubics(period_s), machine):
                return made, place
    return nodes.with_node(nearest, period_s)


def _outwards(node: int, end: int) -> Iterator[int]:
    """Yield nodes from `node` towards `end`, one by one while near, in ever larger steps then."""
    way = 1 if end >= node else -1
    step, distance = 1, 0
    while distance <= abs(end - node):
        yield node + way * distance
        step = step if distance < NEAR_NODES else 2 * step
        distance += step


def _durations(nodes: Nodes, join: int, period_s: float, machine: MachineDescription) -> Iterator[int]:
    """Yield durations of a ramp, longer and longer, each a multiple of four samples."""
    shortest_s = 0.0
    for letter, limits in machine.axes.items():
        around = nodes.velocity_counts_s[letter][max(join - 3, 0) : join + 4]
        speed_mm_s = float(np.abs(around).max()) / limits.counts_per_mm
        # The rate of time changes at most 1.5 times as fast as on average.
        shortest_s = max(shortest_s, 1.5 * speed_mm_s / (ACCELERATION_SHARE * limits.a_max_mm_s2))
    shortest = max(round(shortest_s / period_s), SHORTEST_RAMP_SAMPLES)
    for factor in LENGTHENINGS:
        yield -(-shortest * factor // 4) * 4


def _ramp(nodes: Nodes, begin: int, duration: int, period_s: float, *, rising: bool) -> Nodes:
    """Stretch `duration` / 2 samples of a motion from `begin` on to `duration` samples, from or to rest."""
    first = int(np.searchsorted(nodes.sample, begin, side="right")) - 1
    last = int(np.searchsorted(nodes.sample, begin + duration // 2))
    stretch = nodes.part(first, max(last, first + 1))
    own = _own_samples(stretch.sample, begin, duration, rising=rising)
    plan, rate = _plan_time(own, begin, duration, rising=rising)
    positions, velocities = stretch.state_at(plan, period_s)
    return Nodes(
        own,
        {letter: np.rint(values).astype(np.int64) for letter, values in positions.items()},
        {letter: np.rint(values * rate).astype(np.int64) for letter, values in velocities.items()},
    )


def _plan_time(own: IntArray, begin: int, duration: int, *, rising: bool) -> tuple[FloatArray, FloatArray]:
    """Plan time, in samples, and the rate at which it passes, at samples (n,) of a ramp."""
    u = own / duration if rising else 1 - own / duration
    done = duration * u**3 * (1 - u / 2)
    plan = begin + (done if rising else duration / 2 - done)
    return plan, u**2 * (3 - 2 * u)


def _own_samples(nodes: IntArray, begin: int, duration: int, *, rising: bool) -> IntArray:
    """Samples of a ramp at which it gets nodes: where it passes those of the motion, and in between.

    At a node the acceleration jumps, which one cubic across it would have to make up for.
    """
    every = np.arange(0, duration + 1, 2)
    plan, _ = _plan_time(every, begin, duration, rising=rising)
    passed = every[np.searchsorted(plan, nodes[(nodes > begin) & (nodes < begin + duration // 2)])]
    chosen = [0]
    for sample in (*passed.tolist(), duration):
        gap = sample - chosen[-1]
        if sample < duration and (gap < SHORTEST_PIECE_SAMPLES or duration - sample < SHORTEST_PIECE_SAMPLES):
            continue
        pieces = -(-gap // LONGEST_PIECE_SAMPLES)
        before = chosen[-1]
        chosen += [before + 2 * round(gap * k / pieces / 2) for k in range(1, pieces)]
        chosen.append(sample)
    return np.array(chosen, dtype=np.int64)
