"""The quadratic programme over the free node velocities of both axes, each scaled by its local mean speed, on OSQP."""

from __future__ import annotations

import numpy as np
import osqp
from numpy.typing import NDArray
from scipy import sparse

from ibfctl.schedule.task import AxisTask, Tasks

FloatArray = NDArray[np.float64]
Pair = tuple[FloatArray, FloatArray]

# Share of every limit kept free for the tolerance of the solver.
SOLVER_MARGIN = 2e-3
_TOLERANCE = 2e-4
_ITERATIONS = 250

_HAS_ANSWER = (
    osqp.SolverStatus.OSQP_SOLVED,
    osqp.SolverStatus.OSQP_SOLVED_INACCURATE,
    osqp.SolverStatus.OSQP_MAX_ITER_REACHED,
)


def solve_programme(
    tasks: Tasks,
    time_s: FloatArray,
    corridor_mm: float | FloatArray,
    held_mm_s: Pair,
    wanted: NDArray[np.bool_],
) -> Pair:
    """Solve for the velocities of some nodes; whether they hold is for the caller to check.

    Parameters
    ----------
    tasks, time_s, corridor_mm
        As for the whole path.
    held_mm_s : pair of (n + 1,) float64
        Velocities that the other nodes keep.
    wanted : (n + 1,) bool
        Nodes to be solved for, where their axis may move at all.

    Returns
    -------
    pair of (n + 1,) float64
        `held_mm_s` with the wanted nodes replaced; at rest there without an answer from the solver.
    """
    columns = _Columns(tasks, time_s, held_mm_s, wanted)
    if not columns.width:
        return held_mm_s
    jumps, limits = _Rows(columns), _Rows(columns)
    for axis in (0, 1):
        _add_jumps(jumps, axis)
        _add_limits(limits, axis)
    _add_corridor(limits, corridor_mm)
    rows, constant = jumps.matrix(), np.concatenate(jumps.held)
    objective = sparse.csc_matrix(rows.T @ rows)
    weight = 1 / max(float(objective.diagonal().mean()), 1e-300)
    solver = osqp.OSQP(algebra="builtin")
    solver.setup(
        sparse.triu(weight * objective, format="csc"),
        weight * (rows.T @ constant),
        limits.matrix(),
        np.concatenate(limits.lower),
        np.concatenate(limits.upper),
        verbose=False,
        eps_abs=_TOLERANCE,
        eps_rel=_TOLERANCE,
        max_iter=_ITERATIONS,
        # Where one stretch cannot be done the others still get their answer: no early end as infeasible.
        eps_prim_inf=1e-15,
        # Polishing reports to the process' standard output whatever `verbose` says.
        polishing=False,
    )
    result = solver.solve(raise_error=False)
    answer = np.zeros(columns.width)
    if result.info.status_val in _HAS_ANSWER and np.isfinite(result.x).all():
        answer = np.maximum(np.asarray(result.x, dtype=np.float64), 0.0)
    return columns.filled(answer)


def acceleration_jumps(
    move_mm: FloatArray, time_s: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Acceleration jump at every node as before*v[i-1] + here*v[i] + after*v[i+1] + constant, (n + 1,) each."""
    zero = np.zeros(1)
    inverse = 1 / time_s
    pull = 6 * move_mm * inverse**2
    left, right = np.concatenate([zero, inverse]), np.concatenate([inverse, zero])
    return (
        -2 * left,
        -4 * (left + right),
        -2 * right,
        np.concatenate([zero, pull]) + np.concatenate([pull, zero]),
    )


class _Columns:
    """The wanted nodes of both axes as columns of the programme, each in units of its local mean speed."""

    def __init__(self, tasks: Tasks, time_s: FloatArray, held_mm_s: Pair, wanted: NDArray[np.bool_]) -> None:
        self.tasks, self.time_s = tasks, time_s
        self.free = tasks[0].free & wanted, tasks[1].free & wanted
        self.held = tuple(np.where(free, 0.0, held) for free, held in zip(self.free, held_mm_s, strict=True))
        first = int(self.free[0].sum())
        self.width = first + int(self.free[1].sum())
        self.column = np.cumsum(self.free[0]) - 1, first + np.cumsum(self.free[1]) - 1
        self.unit = tuple(self._mean_speed(task) for task in tasks)

    def _mean_speed(self, task: AxisTask) -> FloatArray:
        """Mean speeds (n + 1,) of one axis around the nodes."""
        speed = np.zeros(self.time_s.size + 1)
        speed[1:-1] = (task.move_mm[1:] + task.move_mm[:-1]) / (self.time_s[1:] + self.time_s[:-1])
        return speed

    def filled(self, answer: FloatArray) -> Pair:
        """Velocities of all nodes (n + 1,) of both axes with `answer` (width,) at the wanted ones."""
        velocity = self.held[0].copy(), self.held[1].copy()
        for axis in (0, 1):
            free = self.free[axis]
            velocity[axis][free] = answer[self.column[axis][free]] * self.unit[axis][free]
        return velocity


class _Rows:
    """Rows of a sparse matrix over the columns, collected entry by entry; what the held nodes add is kept apart."""

    def __init__(self, columns: _Columns) -> None:
        self.columns = columns
        self.lower: list[FloatArray] = []
        self.upper: list[FloatArray] = []
        self.held: list[FloatArray] = []
        self._entries: list[tuple[FloatArray, NDArray[np.int64], NDArray[np.int64]]] = []
        self._count = 0

    def add(
        self,
        *entries: tuple[int, NDArray[np.int64], FloatArray],
        lower: FloatArray | float = 0.0,
        upper: FloatArray | float = 0.0,
    ) -> None:
        """Add r rows, each a sum over `entries` (axis, nodes (r,), coefficients (r,)), with its bounds."""
        size, columns = entries[0][1].size, self.columns
        held = np.zeros(size)
        for axis, node, coefficient in entries:
            held += coefficient * columns.held[axis][node]
            free = np.flatnonzero(columns.free[axis][node])
            at = node[free]
            values = coefficient[free] * columns.unit[axis][at]
            self._entries.append((values, self._count + free, columns.column[axis][at]))
        self._count += size
        self.held.append(held)
        self.lower.append(lower - held)
        self.upper.append(upper - held)

    def matrix(self) -> sparse.csc_matrix:
        """Return the rows as OSQP wants them: the older matrix class."""
        values, rows, columns = (np.concatenate(parts) for parts in zip(*self._entries, strict=True))
        return sparse.csc_matrix((values, (rows, columns)), shape=(self._count, self.columns.width))


def _add_jumps(rows: _Rows, axis: int) -> None:
    """Acceleration jumps at the nodes that a wanted one of an axis touches; their constant part as if it were held."""
    columns = rows.columns
    free = columns.free[axis]
    touched = free.copy()
    touched[1:] |= free[:-1]
    touched[:-1] |= free[1:]
    node = np.flatnonzero(touched)
    before, here, after, constant = acceleration_jumps(columns.tasks[axis].move_mm, columns.time_s)
    last = free.size - 1
    rows.add(
        (axis, np.maximum(node - 1, 0), before[node]),
        (axis, node, here[node]),
        (axis, np.minimum(node + 1, last), after[node]),
    )
    rows.held[-1] += constant[node]


def _add_limits(rows: _Rows, axis: int) -> None:
    """Limits of one axis, all of order one."""
    columns, task = rows.columns, rows.columns.tasks[axis]
    free = columns.free[axis]
    moving = np.flatnonzero(free[:-1] | free[1:])
    move, h = task.move_mm[moving], columns.time_s[moving]
    mean = move / h
    # Rounding towards zero moves a velocity by up to one step, an acceleration by up to six of them over h.
    step = task.resolution_mm_s
    limit = np.maximum(task.a_max_mm_s2 - 6 * step / h, 0.5 * task.a_max_mm_s2) * (1 - SOLVER_MARGIN)
    v_max = max(task.v_max_mm_s - 2 * step, 0.5 * task.v_max_mm_s) * (1 - SOLVER_MARGIN)
    pull, push = 6 * mean / h / limit, 2 / h / limit

    def between(first: FloatArray, second: FloatArray, lower: FloatArray, upper: FloatArray) -> None:
        rows.add((axis, moving, first), (axis, moving + 1, second), lower=lower, upper=upper)

    between(-2 * push, -push, -1 - pull, 1 - pull)
    between(push, 2 * push, -1 + pull, 1 + pull)
    # Middle Bernstein coefficient of the velocity over the mean speed: neither reversal nor overspeed.
    forward = np.minimum(SOLVER_MARGIN + 2 * step / np.abs(mean), 1.0) - 3
    between(-1 / mean, -1 / mean, forward, v_max / np.abs(mean) - 3)
    node = np.flatnonzero(free)
    unit = columns.unit[axis][node]
    rows.add((axis, node, 1 / unit), upper=v_max / np.abs(unit))
    if np.isfinite(task.j_max_mm_s3):
        # Rounding moves a jerk by up to twelve steps over h².
        most = np.maximum(task.j_max_mm_s3 - 12 * step / h**2, 0.5 * task.j_max_mm_s3) * (1 - SOLVER_MARGIN)
        turn, twist = 12 * move / h**3 / most, 6 / h**2 / most
        between(twist, twist, turn - 1, turn + 1)


def _add_corridor(rows: _Rows, corridor_mm: float | FloatArray) -> None:
    """Bound the velocity across the chord at both ends of slanted segments.

    The distance from the chord is at most a quarter of the segment's time times the larger of the two.
    """
    columns = rows.columns
    x, y = columns.tasks
    touched = columns.free[0] | columns.free[1]
    slanted = np.flatnonzero((x.move_mm != 0) & (y.move_mm != 0) & (touched[:-1] | touched[1:]))
    if not slanted.size:
        return
    move_x, move_y, time_s = x.move_mm[slanted], y.move_mm[slanted], columns.time_s[slanted]
    length = np.hypot(move_x, move_y)
    speed = length / time_s
    step = np.hypot(x.resolution_mm_s, y.resolution_mm_s)
    corridor = np.broadcast_to(corridor_mm, columns.time_s.shape)[slanted]
    bound = np.maximum(4 * corridor * (1 - SOLVER_MARGIN) / time_s - step, 0.0) / speed
    for node in (slanted, slanted + 1):
        rows.add((0, node, -move_y / length / speed), (1, node, move_x / length / speed), lower=-bound, upper=bound)
