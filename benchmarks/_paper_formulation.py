"""The velocity scheduler of Wang et al. 2023 (J. Manuf. Process. 88, Eqs. 9 to 18), as a peer to measure against.

Each axis for itself has 6N unknowns: the four coefficients of every cubic, and velocity and acceleration at its end.
All of Eq. 9 is met in the least squares alone; hard are the continuity of the acceleration (Eq. 13), the limits at the
nodes (Eq. 2) and the sign of the velocities (Eq. 18). Three things are not as printed, none of which moves the
optimum but the second:

- Time is local to each segment and runs from 0 to 1, and every unknown is measured in its own size. In absolute time
  the matrix cannot be told from a singular one after some hundred segments, and solvers stop anywhere.
- Rows of the least squares are weighted to be comparable (positions by the mean step, velocities by that over the mean
  time, accelerations by that over its square), or, with `weighted=False`, left in mm, mm/s and mm/s² as printed.
- The two rows that would set the first node's velocity to that of the start (the first two of Eq. 16) are left out:
  velocity and acceleration at the start are known and stand in the rows of the first segment.

The optimum is found by an interior point method and proved by its KKT residual; nothing is taken on a status.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu

from ibfctl.machine.description import MachineDescription
from ibfctl.machine.program import AxisProgram, PvtProgram

FloatArray = NDArray[np.float64]

_ITERATIONS = 100
# Relative to the largest term of the gradient, and to the objective's own scale of one.
OPTIMALITY = 1e-10


@dataclass(frozen=True)
class Peer:
    """What the paper's formulation gives for a program's positions and times.

    Attributes
    ----------
    program
        The same positions and times with its velocities, rounded as the controller gets them.
    kkt_residual
        Largest of stationarity, equality and complementarity over both axes; below `OPTIMALITY`.
    """

    program: PvtProgram
    kkt_residual: float


def paper_program(
    program: PvtProgram, machine: MachineDescription, *, weighted: bool = True, on_path: bool = False
) -> Peer:
    """Replace the velocities of a program by those of the paper's formulation.

    With `on_path`, a condition that the paper does not have is added in its favour: an axis rests at every node beside
    a segment in which it should stand, and where it turns back. On a maze that keeps the motion on its path.

    Raises
    ------
    ArithmeticError
        If the optimum is not reached to `OPTIMALITY`.
    """
    axes, worst = {}, 0.0
    for coordinate in ("x", "y"):
        axis, limits = program.axis_of(coordinate), machine.axis_of(coordinate)
        move_mm = axis.increment_counts / axis.counts_per_mm
        velocity, residual = paper_velocities(
            move_mm, program.time_s, limits.v_max_mm_s, limits.a_max_mm_s2, weighted=weighted, on_path=on_path
        )
        counts = np.rint(velocity * axis.counts_per_mm).astype(np.int64)
        # The controller stops at the end: the least squares only come near it.
        counts[-1] = 0
        axes[program.coordinates[coordinate]] = AxisProgram(
            axis.increment_counts, counts, axis.start_counts, axis.counts_per_mm
        )
        worst = max(worst, residual)
    return Peer(PvtProgram(axes, program.coordinates, program.time_samples, program.sample_period_s), worst)


def paper_velocities(
    move_mm: FloatArray,
    time_s: FloatArray,
    v_max_mm_s: float,
    a_max_mm_s2: float,
    *,
    weighted: bool,
    on_path: bool = False,
) -> tuple[FloatArray, float]:
    """Velocities (N,) at the ends of segments by Eqs. 9 to 18, and the KKT residual of the optimum."""
    n, h = move_mm.size, time_s
    step, pace = float(np.abs(move_mm).mean()), float(h.mean())
    size = np.array([step, step / pace, step / pace**2])  # mm, mm/s, mm/s²
    row = np.arange(n)

    def place(kind: int, segment: NDArray[np.int64], values: FloatArray) -> sparse.csr_array:
        """Make rows with one entry each, for unknown `kind` (0 to 5) of the segments."""
        return sparse.csr_array((values, (np.arange(segment.size), 6 * segment + kind)), shape=(segment.size, 6 * n))

    one = np.ones(n)
    # Unknowns: k1..k4 of k1 u³ + k2 u² + k3 u + k4 in steps, u = t/h; velocity and acceleration in their sizes.
    start_velocity, end_velocity = place(2, row, pace / h), sum(place(k, row, (3 - k) * pace / h) for k in (0, 1, 2))
    start_push = place(1, row, 2 * (pace / h) ** 2)
    end_push = start_push + place(0, row, 6 * (pace / h) ** 2)
    # What the segment before ended with: row i, unknown of segment i - 1; nothing in the first row.
    shift = sparse.eye_array(n, k=-1, format="csr")
    velocity, push = place(4, row, one), place(5, row, one)
    last = np.array([n - 1])
    blocks = [
        (0, place(3, row, one), np.zeros(n)),
        (0, sum(place(k, row, one) for k in range(4)), move_mm / step),
        (1, start_velocity - shift @ velocity, np.zeros(n)),
        (1, end_velocity - velocity, np.zeros(n)),
        (2, start_push - shift @ push, np.zeros(n)),
        (2, end_push - push, np.zeros(n)),
        (1, place(4, last, np.ones(1)), np.zeros(1)),
        (2, place(5, last, np.ones(1)), np.zeros(1)),
    ]
    weights = np.ones(3) if weighted else size / size.max()
    rows = sparse.vstack([weights[kind] * block for kind, block, _ in blocks], format="csr")
    wanted = np.concatenate([weights[kind] * values for kind, _, values in blocks])
    continuous = (end_push[:-1] - start_push[1:]).tocsr()
    lower, upper = np.full(6 * n, -np.inf), np.full(6 * n, np.inf)
    v_max, a_max = v_max_mm_s / size[1], a_max_mm_s2 / size[2]
    forward = np.append(move_mm[1:] >= 0, True)
    lower[4::6], upper[4::6] = np.where(forward, 0.0, -v_max), np.where(forward, v_max, 0.0)
    lower[-2] = -v_max
    lower[5::6], upper[5::6] = -a_max, a_max
    if on_path:
        goes_on = (np.sign(move_mm[1:]) == np.sign(move_mm[:-1])) & (move_mm[1:] != 0)
        resting = np.flatnonzero(np.append(~goes_on, True))
        continuous = sparse.vstack([continuous, place(4, resting, np.ones(resting.size))], format="csr")
        lower[6 * resting + 4], upper[6 * resting + 4] = -v_max, v_max
    answer, residual = bounded_least_squares(rows, wanted, continuous, lower, upper)
    return answer[4::6] * size[1], residual


def bounded_least_squares(
    rows: sparse.csr_array, wanted: FloatArray, equal: sparse.csr_array, lower: FloatArray, upper: FloatArray
) -> tuple[FloatArray, float]:
    """Minimise 1/2 |rows x - wanted|² with equal x = 0 and bounds, by Mehrotra's predictor and corrector.

    Returns
    -------
    x, kkt_residual
        The optimum, and how far it may be from one.

    Raises
    ------
    ArithmeticError
        If `OPTIMALITY` is not reached.
    """
    quadratic, linear = (rows.T @ rows).tocsc(), -(rows.T @ wanted)
    bounded = np.flatnonzero(np.isfinite(lower))
    middle, reach = 0.5 * (lower[bounded] + upper[bounded]), 0.5 * (upper[bounded] - lower[bounded])
    x, y = np.zeros(lower.size), np.zeros(equal.shape[0])
    x[bounded] = middle
    below, above = np.ones(reach.size), np.ones(reach.size)
    scale = max(1.0, float(np.abs(linear).max()))
    for _ in range(_ITERATIONS):
        down, up = x[bounded] - middle + reach, middle + reach - x[bounded]
        gradient = quadratic @ x + linear + equal.T @ y
        gradient[bounded] += above - below
        residual = max(
            float(np.abs(gradient).max()) / scale,
            float(np.abs(equal @ x).max(initial=0.0)),
            float(np.maximum(down * below, up * above).max()) / scale,
        )
        if residual < OPTIMALITY:
            return x, residual
        newton = _Newton(quadratic, equal, bounded, gradient, equal @ x, (down, up), (below, above))
        predicted = newton.direction(-down * below, -up * above)
        share = _share(predicted, newton)
        gap = down @ below + up @ above
        inner = predicted.x[bounded]
        reached = (down + share * inner) @ (below + share * predicted.below)
        reached += (up - share * inner) @ (above + share * predicted.above)
        centre = gap / (2 * reach.size) * (reached / gap) ** 3
        chosen = newton.direction(
            centre - down * below - inner * predicted.below, centre - up * above + inner * predicted.above
        )
        share = 0.995 * _share(chosen, newton)
        x, y = x + share * chosen.x, y + share * chosen.y
        below, above = below + share * chosen.below, above + share * chosen.above
    raise ArithmeticError(f"the paper's formulation is not solved: KKT residual {residual:.2g}")


@dataclass(frozen=True)
class _Direction:
    """Changes of the unknowns, of the prices of the equalities, and of the prices of both bounds."""

    x: FloatArray
    y: FloatArray
    below: FloatArray
    above: FloatArray


@dataclass(frozen=True)
class _Newton:
    """The linear system of one iterate, factorised once."""

    quadratic: sparse.csc_array
    equal: sparse.csr_array
    bounded: NDArray[np.int64]
    gradient: FloatArray
    unequal: FloatArray
    slack: tuple[FloatArray, FloatArray]
    price: tuple[FloatArray, FloatArray]

    @cached_property
    def _system(self) -> tuple[sparse.csc_array, SuperLU]:
        barrier = np.zeros(self.gradient.size)
        barrier[self.bounded] = self.price[0] / self.slack[0] + self.price[1] / self.slack[1]
        corner = -1e-12 * sparse.eye_array(self.unequal.size)
        matrix = sparse.block_array(
            [[self.quadratic + sparse.diags_array(barrier), self.equal.T], [self.equal, corner]], format="csc"
        )
        return matrix, splu(matrix)

    def direction(self, lower_gap: FloatArray, upper_gap: FloatArray) -> _Direction:
        """Newton's direction to stationarity and to given changes of the complementarity of both bounds."""
        matrix, factors = self._system
        push = -self.gradient
        push[self.bounded] += lower_gap / self.slack[0] - upper_gap / self.slack[1]
        right = np.concatenate([push, -self.unequal])
        found = factors.solve(right)
        found += factors.solve(right - matrix @ found)
        x, y = np.split(found, [push.size])
        inner = x[self.bounded]
        below = (lower_gap - self.price[0] * inner) / self.slack[0]
        return _Direction(x, y, below, (upper_gap + self.price[1] * inner) / self.slack[1])


def _share(direction: _Direction, newton: _Newton) -> float:
    """Largest share, at most one, of a direction that keeps slacks and prices from below zero."""
    inner, share = direction.x[newton.bounded], 1.0
    changes = inner, -inner, direction.below, direction.above
    for values, change in zip((*newton.slack, *newton.price), changes, strict=True):
        falling = change < 0
        share = min(share, float((-values[falling] / change[falling]).min(initial=1.0)))
    return share
