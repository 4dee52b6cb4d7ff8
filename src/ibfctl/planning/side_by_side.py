"""Methods for dwell times side by side on the same paths, all executed through the same scheduler."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from ibfctl.dwell.methods.damped_lsmr import damped_lsmr
from ibfctl.dwell.methods.inverse_filter import inverse_filter
from ibfctl.dwell.methods.nnls import nnls_then_limits
from ibfctl.dwell.methods.smoothness import slope_rms_s_mm
from ibfctl.dwell.methods.solution import Solution
from ibfctl.dwell.operator import RemovalOperator
from ibfctl.dwell.solver import Cancelled, DwellProblem, Regularisation, never
from ibfctl.errors import CancelledError
from ibfctl.machine.description import MachineDescription
from ibfctl.planning.job import PlanningJob, prepare
from ibfctl.planning.loop import Executed, execute, refine
from ibfctl.planning.options import PlanOptions
from ibfctl.planning.plan import peaks
from ibfctl.planning.planner import Progress, solve_dwell
from ibfctl.surface.influence import InfluenceFunction
from ibfctl.surface.map import SurfaceMap

FloatArray = NDArray[np.float64]
Method = Callable[[DwellProblem, Cancelled], Solution]

# Ours is not among them: it judges on the pixels of the map, and may know the motion.
PEERS: Mapping[str, Method] = {
    "inverse filter": lambda problem, cancelled: inverse_filter(problem, cancelled=cancelled),
    "NNLS, then limits": lambda problem, cancelled: nnls_then_limits(problem, cancelled=cancelled),
    "damped LSMR": lambda problem, cancelled: damped_lsmr(problem, cancelled=cancelled),
    "damped LSMR, extended": lambda problem, cancelled: damped_lsmr(problem, extend=True, cancelled=cancelled),
}


@dataclass(frozen=True)
class MethodFigures:
    """What a method plans, and what of it is executed.

    Attributes
    ----------
    ideal_rms_nm
        Residual that its times leave at the dwell points.
    executed_rms_nm, total_time_s, peak_speed_mm_s
        Residual, run time and peak speed of an axis as executed.
    slope_rms_s_mm
        How steep the times are along the path (Ke et al. 2022, Eq. 6).
    distance_from_optimum, bound_violation_s
        What the times prove of themselves, see `Solution`.
    planning_s
        Wall time to the certified program.
    """

    ideal_rms_nm: float
    executed_rms_nm: float
    total_time_s: float
    slope_rms_s_mm: float
    peak_speed_mm_s: float
    distance_from_optimum: float
    bound_violation_s: float
    planning_s: float


def compare_methods(
    surface: SurfaceMap,
    influence: InfluenceFunction,
    machine: MachineDescription,
    paths: Mapping[str, PlanOptions],
    *,
    progress: Progress | None = None,
    cancelled: Cancelled = never,
) -> dict[str, dict[str, MethodFigures]]:
    """Compare the methods on each of `paths`: figures by the name of the path and of the method.

    Parameters
    ----------
    surface, influence, machine
        As for a plan.
    paths
        Options by name, as of `ibfctl.planning.comparison.path_choices`.

    Raises
    ------
    InputError, LimitsError, SolverError, CancelledError
        As `make_plan` does.
    """
    compared = {}
    for index, (name, options) in enumerate(paths.items()):
        if progress is not None:
            progress(f"comparing on {name}", index / len(paths))
        compared[name] = methods_on(prepare(surface, influence, machine, options), cancelled)
    if progress is not None:
        progress("compared", 1.0)
    return compared


def methods_on(job: PlanningJob, cancelled: Cancelled = never) -> dict[str, MethodFigures]:
    """Compare the methods on the path of a job."""
    problem = job.problem(
        RemovalOperator(job.misfit.grid, job.misfit.influence, job.path.dwell_x_mm, job.path.dwell_y_mm),
        job.bounds.lower_s,
    )
    on_pixels = RemovalOperator(job.grid, job.influence, job.path.dwell_x_mm, job.path.dwell_y_mm)
    figures = {}

    def add(name: str, solution: Solution, executed: Executed, begin: float) -> None:
        program = executed.scheduled.program
        figures[name] = MethodFigures(
            job.rms_nm(on_pixels(solution.time_s)),
            executed.rms_nm,
            program.total_time_s,
            slope_rms_s_mm(job.path, solution.time_s),
            max(speed for speed, _ in peaks(program).values()),
            solution.distance_from_optimum,
            solution.bound_violation_s,
            time.perf_counter() - begin,
        )

    for name, method in PEERS.items():
        if cancelled():
            raise CancelledError("the comparison was cancelled", "start it again when wanted")
        begin = time.perf_counter()
        solution = method(problem, cancelled)
        add(name, solution, execute(job, solution.time_s), begin)
    begin = time.perf_counter()
    regularisation = Regularisation(job.options.tikhonov)
    chosen = solve_dwell(job, on_pixels, regularisation, cancelled).chosen
    plain = execute(job, chosen.time_s)
    add("ours, no loop", Solution(problem, chosen.time_s), plain, begin)
    best, _ = refine(job, plain, chosen.price_nm2_s, regularisation, cancelled)
    add("ours", Solution(problem, best.asked_s), best, begin)
    return figures


def summary(compared: Mapping[str, Mapping[str, MethodFigures]]) -> dict[str, object]:
    """Return the JSON form that `ibfctl compare --methods --json` prints."""
    return {
        "methods": {
            path: {method: asdict(figures) for method, figures in methods.items()} for path, methods in compared.items()
        }
    }
