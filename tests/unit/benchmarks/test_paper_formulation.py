"""The peer of `maze_vs_paper` is the paper's formulation at its optimum, or it is no peer."""

from __future__ import annotations

import numpy as np
import osqp
import pytest
from scipy import sparse

from benchmarks._paper_formulation import OPTIMALITY, bounded_least_squares, paper_program, paper_velocities
from ibfctl.path.maze import maze
from ibfctl.schedule.scheduler import schedule
from ibfctl.surface.map import Rectangle
from tests.property.timed_paths import make_machine


def test_the_optimum_of_bounded_least_squares_is_that_of_another_solver() -> None:
    random = np.random.default_rng(2)
    rows = sparse.csr_array(random.normal(size=(30, 20)) * (random.random((30, 20)) < 0.4) + np.eye(30, 20))
    wanted = 3 * random.normal(size=30)
    equal = sparse.csr_array(random.normal(size=(4, 20)))
    lower, upper = np.full(20, -np.inf), np.full(20, np.inf)
    lower[::3], upper[::3] = -0.2, 0.1
    found, residual = bounded_least_squares(rows, wanted, equal, lower, upper)
    assert residual < OPTIMALITY
    assert np.abs(equal @ found).max() < 1e-7
    assert (found >= lower).all()
    assert (found <= upper).all()
    assert ((found < lower + 1e-4) | (found > upper - 1e-4)).sum() >= 3
    solver = osqp.OSQP()
    bounds = sparse.vstack([equal, sparse.eye_array(20)]).tocsc()
    solver.setup(
        sparse.csc_matrix(sparse.triu(rows.T @ rows)),
        -(rows.T @ wanted),
        sparse.csc_matrix(bounds),
        np.concatenate([np.zeros(4), lower]),
        np.concatenate([np.zeros(4), upper]),
        verbose=False,
        eps_abs=1e-10,
        eps_rel=1e-10,
        max_iter=200_000,
        polishing=False,
    )
    other = np.asarray(solver.solve(raise_error=True).x)
    np.testing.assert_allclose(found, other, atol=1e-6)


def test_an_even_motion_between_its_ends_is_found() -> None:
    move_mm, time_s = np.full(40, 0.5), np.full(40, 0.1)
    velocity, residual = paper_velocities(move_mm, time_s, 250.0, 2000.0, weighted=True)
    assert residual < OPTIMALITY
    np.testing.assert_allclose(velocity[15:25], 5.0, rtol=1e-3)
    assert abs(velocity[-1]) < 2.0


def test_told_to_rest_where_an_axis_stands_the_peer_stays_on_its_path() -> None:
    path = maze(Rectangle(-3.0, 3.0, -2.0, 2.0), 0.5, seed=1)
    machine = make_machine()
    dwell_s = np.random.default_rng(0).uniform(0.06, 0.15, path.segments)
    scheduled = schedule(path, dwell_s, machine, 0.025, stretch=True)
    peers = [paper_program(scheduled.program, machine, on_path=on_path).program for on_path in (False, True)]
    astray = [[np.abs(axis.end_velocity_counts_s[axis.increment_counts == 0]).max() for axis in peer.axes.values()]
              for peer in peers]  # fmt: skip
    assert min(astray[0]) > 100
    assert max(astray[1]) == 0


@pytest.mark.parametrize("weighted", [True, False])
def test_velocities_keep_the_sign_of_the_next_move_and_the_limits(weighted: bool) -> None:
    path = maze(Rectangle(-3.0, 3.0, -2.0, 2.0), 0.5, seed=1)
    random = np.random.default_rng(0)
    machine = make_machine()
    scheduled = schedule(path, random.uniform(0.06, 0.15, path.segments), machine, 0.025, stretch=True)
    peer = paper_program(scheduled.program, machine, weighted=weighted)
    assert peer.kkt_residual < OPTIMALITY
    for letter, axis in peer.program.axes.items():
        move, velocity = axis.increment_counts, axis.end_velocity_counts_s
        assert (np.where(move[1:] >= 0, velocity[:-1], -velocity[:-1]) >= 0).all()
        assert np.abs(velocity).max() <= machine.axes[letter].v_max_mm_s * axis.counts_per_mm  # type: ignore[index]
        assert velocity[-1] == 0
        np.testing.assert_array_equal(move, scheduled.program.axes[letter].increment_counts)
