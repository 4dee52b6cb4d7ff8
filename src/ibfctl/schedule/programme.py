"""The quadratic programme over the free node velocities of both axes, each scaled by its local mean speed, on OSQP."""

from __future__ import annotations

import numpy as np
import osqp
from numpy.typing import NDArray
from scipy import sparse

from ibfctl.schedule.task import AxisTask, Tasks

FloatArray = NDArray[np.float64]

# Share of every limit kept free for the tolerance of the solver.
SOLVER_MARGIN = 2e-3
_TOLERANCE = 2e-4
_ITERATIONS = 1000

_HAS_ANSWER = (
    osqp.SolverStatus.OSQP_SOLVED,
    osqp.SolverStatus.OSQP_SOLVED_INACCURATE,
    osqp.SolverStatus.OSQP_MAX_ITER_REACHED,
)


def solve_programme(tasks: Tasks, time_s: FloatArray, corridor_mm: float) -> tuple[FloatArray, FloatArray]:
    """Solve for the node velocities (n + 1,) of both axes; whether they hold is for the caller to check.

    Without an answer from the solver the axes rest at every node.
    """
    if not (tasks[0].free.any() or tasks[1].free.any()):
        return np.zeros(tasks[0].free.size), np.zeros(tasks[1].free.size)
    scales = _node_speed(tasks[0], time_s), _node_speed(tasks[1], time_s)
    widths = [int(task.free.sum()) for task in tasks]
    quadratic, linear, rows, lower, upper = [], [], [], [], []
    for index, (task, scale) in enumerate(zip(tasks, scales, strict=True)):
        before, here, after, constant = acceleration_jumps(task.move_mm, time_s)
        jumps = sparse.diags_array([before[1:], here, after[:-1]], offsets=[-1, 0, 1], format="csc")
        jumps = (jumps @ sparse.diags_array(scale)).tocsc()[:, task.free]
        quadratic.append(jumps.T @ jumps)
        linear.append(jumps.T @ constant)
        for block, low, high in _limit_rows(task, scale, time_s):
            padding = [sparse.csr_array((block.shape[0], width)) for width in widths]
            padding[index] = block
            rows.append(sparse.hstack(padding, format="csr"))
            lower.append(low)
            upper.append(high)
    for block, bound in _corridor_rows(tasks, scales, time_s, corridor_mm):
        rows.append(block)
        lower.append(-bound)
        upper.append(bound)
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
    velocities = np.zeros(scales[0].size), np.zeros(scales[1].size)
    velocities[0][tasks[0].free] = answer[: widths[0]]
    velocities[1][tasks[1].free] = answer[widths[0] :]
    return velocities[0] * scales[0], velocities[1] * scales[1]


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


def _corridor_rows(
    tasks: Tasks, scales: tuple[FloatArray, FloatArray], time_s: FloatArray, corridor_mm: float
) -> list[tuple[sparse.csr_array, FloatArray]]:
    """Rows (block, bound) for the velocity across the chord at both ends of slanted segments.

    The distance from the chord is at most a quarter of the segment's time times the larger of the two.
    """
    slanted = np.flatnonzero((tasks[0].move_mm != 0) & (tasks[1].move_mm != 0))
    if not slanted.size:
        return []
    length = np.hypot(tasks[0].move_mm[slanted], tasks[1].move_mm[slanted])
    speed = length / time_s[slanted]
    step = np.hypot(tasks[0].resolution_mm_s, tasks[1].resolution_mm_s)
    bound = np.maximum(4 * corridor_mm * (1 - SOLVER_MARGIN) / time_s[slanted] - step, 0.0)
    across = -tasks[1].move_mm[slanted] / length, tasks[0].move_mm[slanted] / length
    index = np.arange(slanted.size)
    blocks = []
    for node in (slanted, slanted + 1):
        parts = [
            sparse.csc_array((weight * scale[node] / speed, (index, node)), shape=(slanted.size, scale.size))[
                :, task.free
            ]
            for weight, scale, task in zip(across, scales, tasks, strict=True)
        ]
        blocks.append((sparse.hstack(parts, format="csr"), bound / speed))
    return blocks


def _limit_rows(
    task: AxisTask, scale: FloatArray, time_s: FloatArray
) -> list[tuple[sparse.csr_array, FloatArray, FloatArray]]:
    """Rows (block, lower, upper) of one axis, all of order one."""
    moving = np.flatnonzero(task.free[:-1] | task.free[1:])
    move, h = task.move_mm[moving], time_s[moving]
    mean = move / h
    # Rounding towards zero moves a velocity by up to one step, an acceleration by up to six of them over h.
    step = task.resolution_mm_s
    limit = np.maximum(task.a_max_mm_s2 - 6 * step / h, 0.5 * task.a_max_mm_s2) * (1 - SOLVER_MARGIN)
    index = np.arange(moving.size)

    def rows(first: FloatArray, second: FloatArray) -> sparse.csr_array:
        values = np.concatenate([first * scale[moving], second * scale[moving + 1]])
        places = np.concatenate([index, index]), np.concatenate([moving, moving + 1])
        return sparse.csc_array((values, places), shape=(moving.size, scale.size))[:, task.free].tocsr()

    pull = 6 * move / h**2 / limit
    v_max = max(task.v_max_mm_s - 2 * step, 0.5 * task.v_max_mm_s) * (1 - SOLVER_MARGIN)
    nodes = np.flatnonzero(task.free)
    jerk_limits = []
    if np.isfinite(task.j_max_mm_s3):
        # Rounding moves a jerk by up to twelve steps over h².
        most = np.maximum(task.j_max_mm_s3 - 12 * step / h**2, 0.5 * task.j_max_mm_s3) * (1 - SOLVER_MARGIN)
        turn = 12 * move / h**3 / most
        jerk_limits.append((rows(6 / h**2 / most, 6 / h**2 / most), turn - 1, turn + 1))
    return [
        *jerk_limits,
        (rows(-4 / h / limit, -2 / h / limit), -1 - pull, 1 - pull),
        (rows(2 / h / limit, 4 / h / limit), -1 + pull, 1 + pull),
        # Middle Bernstein coefficient of the velocity over the mean speed: neither reversal nor overspeed.
        (
            rows(-1 / mean, -1 / mean),
            np.minimum(SOLVER_MARGIN + 2 * step / np.abs(mean), 1.0) - 3,
            v_max / np.abs(mean) - 3,
        ),
        (sparse.eye_array(nodes.size, format="csr"), np.zeros(nodes.size), v_max / np.abs(scale[nodes])),
    ]


def _for_osqp(matrix: sparse.sparray) -> sparse.csc_matrix:
    """OSQP wants the older matrix class and 32-bit indices."""
    result = sparse.csc_matrix(matrix)
    result.sort_indices()
    result.indices, result.indptr = result.indices.astype(np.int32), result.indptr.astype(np.int32)
    return result


def _node_speed(task: AxisTask, time_s: FloatArray) -> FloatArray:
    """Signed mean speed around each node, (n + 1,): the unit in which its velocity is sought; 1 at fixed nodes."""
    scale = np.ones(task.free.size)
    mean = (task.move_mm[1:] + task.move_mm[:-1]) / (time_s[1:] + time_s[:-1])
    scale[1:-1] = np.where(task.free[1:-1], mean, 1.0)
    return scale
