"""The descent against a plain two-metric projected Newton: the same optimum, and the work until near to it.

Work is counted in applications of the operator and its adjoint, which is where the time of large jobs goes, so that
the figures do not depend on the machine. Gaps are of the objective, relative to the best that a long run reaches.
Close to the optimum of a small job Newton's method is quicker; there the planner solves by interior points.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from benchmarks._planning import made_map, made_tool, stages
from benchmarks._projected_newton import ProjectedNewton
from benchmarks.solver_reference import small_problem
from ibfctl.dwell.solver import Descent, DwellProblem, Regularisation
from ibfctl.planning.job import prepare
from ibfctl.planning.options import PlanOptions

REGULARISATION = Regularisation()
# Of a second, as a share of the squared target.
PRICE_SHARE = 1e-7
# Applications of the long run, and the gap that counts as near.
SMALL, MEDIUM = (40_000, 1e-3), (6_000, 0.05)
STEP, MOST, FIXED = 10, 4_000, 400
MEDIUM_PIXELS, MEDIUM_PITCH_MM = 256, 0.5


def run() -> dict[str, Any]:
    """Solve a small job, whose optimum both must reach, and a medium one of some 7 000 times."""
    metrics: dict[str, float] = {}
    for name, problem, (long, near) in (("small", small_problem(0.02, 0.3), SMALL), ("medium", _medium(), MEDIUM)):
        price = PRICE_SHARE * float(problem.misfit.target @ problem.misfit.target)
        best = _descent(problem, price)(long)
        work = {}
        for method, start in (("descent", _descent), ("newton", _newton)):
            work[method] = _applications(start(problem, price), (1 + near) * best)
            metrics[f"{name}_{method}_applications"] = work[method]
            metrics[f"{name}_{method}_gap_{FIXED}"] = start(problem, price)(FIXED) / best - 1
        metrics[f"{name}_work_ratio"] = work["descent"] / work["newton"]
        metrics[f"{name}_steps"] = problem.operator.steps
        if name == "small":
            metrics["optimum_difference"] = abs(_newton(problem, price)(long) / best - 1)
    return {
        "metrics": metrics,
        "targets": {
            "optimum_difference": {"max": 1e-6},
            "small_work_ratio": {"max": 1.0},
            "medium_work_ratio": {"max": 1.0},
        },
    }


def _applications(reach: Callable[[int], float], enough: float) -> int:
    """Applications after which the objective is low enough, `MOST` where even they are too few."""
    for applications in range(STEP, MOST + 1, STEP):
        if reach(applications) <= enough:
            return applications
    return MOST


def _descent(problem: DwellProblem, price: float) -> Callable[[int], float]:
    """Make a function that descends to so many applications in all and answers with the objective."""
    descent, done = Descent(problem, REGULARISATION, problem.lower_s), 0

    def reach(applications: int) -> float:
        nonlocal done
        descent.advance(price, applications - done)
        done = applications
        return descent.objective(price)

    return reach


def _newton(problem: DwellProblem, price: float) -> Callable[[int], float]:
    newton = ProjectedNewton(problem, REGULARISATION, price, problem.lower_s.copy())

    def reach(applications: int) -> float:
        newton.advance(applications)
        return Descent(problem, REGULARISATION, newton.time_s).objective(price)

    return reach


def _medium() -> DwellProblem:
    options = PlanOptions(pitch_mm=MEDIUM_PITCH_MM, step_mm=MEDIUM_PITCH_MM)
    job = prepare(made_map(MEDIUM_PIXELS), made_tool(), stages(), options)
    return job.ideal_problem(job.misfit)
