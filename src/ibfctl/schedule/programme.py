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
_ITERATIONS = 1000

_HAS_ANSWER = (
    osqp.SolverStatus.OSQP_SOLVED,
    osqp.SolverStatus.OSQP_SOLVED_INACCURATE,
    osqp.SolverStatus.OSQP_MAX_ITER_REACHED,
)


def solve_programme(
    tasks: Tasks,
    time_s: FloatArray,
    corridor_mm: float,
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
    axes = [_Columns(task, time_s, held, wanted) for task, held in zip(tasks, held_mm_s, strict=True)]
    widths = [axis.width for axis in axes]
    if not any(widths):
        return held_mm_s
    quadratic, linear, rows, lower, upper = [], [], [], [], []
    for index, axis in enumerate(axes):
        jumps, constant = axis.jump_rows()
        quadratic.append(jumps.T @ jumps)
        linear.append(jumps.T @ constant)
        for block, low, high in axis.limit_rows():
            padding = [sparse.csr_array((block.shape[0], width)) for width in widths]
            padding[index] = block
            rows.append(sparse.hstack(padding, format="csr"))
            lower.append(low)
            upper.append(high)
    for block, low, high in _corridor_rows(axes, corridor_mm):
        rows.append(block)
        lower.append(low)
        upper.append(high)
    objective = sparse.block_diag(quadratic, format="csc")
    weight = 1 / max(float(objective.diagonal().mean()), 1e-300)
    solver = osqp.OSQP()
    solver.setup(
        _for_osqp(sparse.triu(weight * objective)),
        weight * np.concatenate(linear),
        _for_osqp(sparse.vstack(rows)),
        np.concatenate(lower),
        np.concatenate(upper),
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
    answer = np.zeros(sum(widths))
    if result.info.status_val in _HAS_ANSWER and np.isfinite(result.x).all():
        answer = np.maximum(np.asarray(result.x, dtype=np.float64), 0.0)
    return axes[0].filled(answer[: widths[0]]), axes[1].filled(answer[widths[0] :])


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
    """The wanted nodes of one axis as columns of the programme, each in units of its local mean speed."""

    def __init__(self, task: AxisTask, time_s: FloatArray, held_mm_s: FloatArray, wanted: NDArray[np.bool_]) -> None:
        self.task, self.time_s = task, time_s
        self.free = task.free & wanted
        self.nodes = np.flatnonzero(self.free)
        self.width = self.nodes.size
        mean = (task.move_mm[1:] + task.move_mm[:-1]) / (time_s[1:] + time_s[:-1])
        self.scale = mean[self.nodes - 1]
        self._held = np.where(self.free, 0.0, held_mm_s)
        self._column = np.cumsum(self.free) - 1

    def filled(self, answer: FloatArray) -> FloatArray:
        """Velocities of all nodes (n + 1,) with `answer` (width,) at the wanted ones."""
        velocity = self._held.copy()
        velocity[self.nodes] = answer * self.scale
        return velocity

    def rows(self, *entries: tuple[NDArray[np.int64], FloatArray]) -> tuple[sparse.csr_array, FloatArray]:
        """Rows of sums of velocities: pairs of nodes (r,) and coefficients (r,); and what the held nodes add, (r,)."""
        size = entries[0][0].size
        constant = np.zeros(size)
        values, places, columns = [], [], []
        for node, coefficient in entries:
            constant += coefficient * self._held[node]
            free = np.flatnonzero(self.free[node])
            column = self._column[node[free]]
            values.append(coefficient[free] * self.scale[column])
            places.append(free)
            columns.append(column)
        parts = np.concatenate(values), (np.concatenate(places), np.concatenate(columns))
        return sparse.csr_array(parts, shape=(size, self.width)), constant

    def jump_rows(self) -> tuple[sparse.csr_array, FloatArray]:
        """Acceleration jumps at the nodes that a wanted one touches, with their constant part."""
        touched = self.free.copy()
        touched[1:] |= self.free[:-1]
        touched[:-1] |= self.free[1:]
        node = np.flatnonzero(touched)
        before, here, after, constant = acceleration_jumps(self.task.move_mm, self.time_s)
        last = self.free.size - 1
        matrix, held = self.rows(
            (np.maximum(node - 1, 0), before[node]), (node, here[node]), (np.minimum(node + 1, last), after[node])
        )
        return matrix, held + constant[node]

    def limit_rows(self) -> list[tuple[sparse.csr_array, FloatArray, FloatArray]]:
        """Rows (block, lower, upper) of the axis' limits, all of order one."""
        task = self.task
        moving = np.flatnonzero(self.free[:-1] | self.free[1:])
        move, h = task.move_mm[moving], self.time_s[moving]
        mean = move / h
        # Rounding towards zero moves a velocity by up to one step, an acceleration by up to six of them over h.
        step = task.resolution_mm_s
        limit = np.maximum(task.a_max_mm_s2 - 6 * step / h, 0.5 * task.a_max_mm_s2) * (1 - SOLVER_MARGIN)
        v_max = max(task.v_max_mm_s - 2 * step, 0.5 * task.v_max_mm_s) * (1 - SOLVER_MARGIN)
        pull = 6 * move / h**2 / limit

        def between(
            first: FloatArray, second: FloatArray, low: FloatArray, high: FloatArray
        ) -> tuple[sparse.csr_array, FloatArray, FloatArray]:
            block, held = self.rows((moving, first), (moving + 1, second))
            return block, low - held, high - held

        found = [
            between(-4 / h / limit, -2 / h / limit, -1 - pull, 1 - pull),
            between(2 / h / limit, 4 / h / limit, -1 + pull, 1 + pull),
            # Middle Bernstein coefficient of the velocity over the mean speed: neither reversal nor overspeed.
            between(
                -1 / mean,
                -1 / mean,
                np.minimum(SOLVER_MARGIN + 2 * step / np.abs(mean), 1.0) - 3,
                v_max / np.abs(mean) - 3,
            ),
            (sparse.eye_array(self.width, format="csr"), np.zeros(self.width), v_max / np.abs(self.scale)),
        ]
        if np.isfinite(task.j_max_mm_s3):
            # Rounding moves a jerk by up to twelve steps over h².
            most = np.maximum(task.j_max_mm_s3 - 12 * step / h**2, 0.5 * task.j_max_mm_s3) * (1 - SOLVER_MARGIN)
            turn = 12 * move / h**3 / most
            found.append(between(6 / h**2 / most, 6 / h**2 / most, turn - 1, turn + 1))
        return found


def _corridor_rows(axes: list[_Columns], corridor_mm: float) -> list[tuple[sparse.csr_array, FloatArray, FloatArray]]:
    """Rows (block, lower, upper) for the velocity across the chord at both ends of slanted segments.

    The distance from the chord is at most a quarter of the segment's time times the larger of the two.
    """
    x, y = axes[0].task, axes[1].task
    touched = axes[0].free | axes[1].free
    slanted = np.flatnonzero((x.move_mm != 0) & (y.move_mm != 0) & (touched[:-1] | touched[1:]))
    if not slanted.size:
        return []
    length = np.hypot(x.move_mm[slanted], y.move_mm[slanted])
    time_s = axes[0].time_s[slanted]
    speed = length / time_s
    step = np.hypot(x.resolution_mm_s, y.resolution_mm_s)
    bound = np.maximum(4 * corridor_mm * (1 - SOLVER_MARGIN) / time_s - step, 0.0) / speed
    across = -y.move_mm[slanted] / length / speed, x.move_mm[slanted] / length / speed
    found = []
    for node in (slanted, slanted + 1):
        parts = [axis.rows((node, weight)) for axis, weight in zip(axes, across, strict=True)]
        held = parts[0][1] + parts[1][1]
        found.append((sparse.hstack([block for block, _ in parts], format="csr"), -bound - held, bound - held))
    return found


def _for_osqp(matrix: sparse.sparray) -> sparse.csc_matrix:
    """OSQP wants the older matrix class and 32-bit indices."""
    result = sparse.csc_matrix(matrix)
    result.sort_indices()
    result.indices, result.indptr = result.indices.astype(np.int32), result.indptr.astype(np.int32)
    return result
