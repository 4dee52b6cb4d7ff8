"""Dwell times of several tools: ours, all at once or one after the other (Ke et al. 2022, Opt. Express 30)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ibfctl.dwell.aim import Aim, Share, ignored
from ibfctl.dwell.joint import JointRemoval, joint_problem
from ibfctl.dwell.methods.damped_lsmr import damped_lsmr
from ibfctl.dwell.misfit import CELLS_PER_WIDTH, COARSE_CELLS_PER_WIDTH, cell_size, make_misfit
from ibfctl.dwell.operator import Precision, RemovalOperator
from ibfctl.dwell.smoothest import smoothest
from ibfctl.dwell.solver import Cancelled, DwellProblem, Regularisation
from ibfctl.dwell.trade_off import Effort, aim_at
from ibfctl.errors import LimitsError
from ibfctl.planning.job import PlanningJob
from ibfctl.planning.sequence import Method

FloatArray = NDArray[np.float64]

# A step of the descent takes as long as those of all tools together: fewer rounds than for one, where the job is large.
ROUNDS = 10


@dataclass(frozen=True)
class JointTimes:
    """Dwell times of several tools.

    Attributes
    ----------
    time_s
        (n,) float64 for each tool.
    price_nm2_s, smoothing_nm2_s2
        Price of a second and weight of changes along the path with which ours were solved; zero for the others.
    """

    time_s: tuple[FloatArray, ...]
    price_nm2_s: float = 0.0
    smoothing_nm2_s2: float = 0.0


def ideal_operators(jobs: Sequence[PlanningJob]) -> list[RemovalOperator]:
    """Removal on the pixels of the map from the times at the dwell points of each job."""
    return [RemovalOperator(job.grid, job.influence, job.path.dwell_x_mm, job.path.dwell_y_mm) for job in jobs]


def solve_jointly(
    jobs: Sequence[PlanningJob],
    method: Method,
    changes_s: float,
    cancelled: Cancelled,
    progress: Share = ignored,
    *,
    preview: bool = False,
) -> JointTimes:
    """Solve the dwell times of jobs on the same map, the narrowest tool last.

    Parameters
    ----------
    jobs
        One per tool; the aim is that of the last.
    method
        "ours": within the bounds of each machine, to the aim. "mto": damped LSMR of all tools at once, Algorithm 2.
        "sto": damped LSMR on the extended surface, each tool on what the last leaves, Algorithm 1.
    changes_s
        Time of all changes of tools, which a limit on the total time includes.
    preview
        Stop ours at the coarse cells on which it searches.

    Raises
    ------
    LimitsError
        If the machines need more than the time aimed at, or the residual aimed at cannot be reached.
    CancelledError
        When the planning was cancelled.
    """
    if method == "ours":
        return _ours(jobs, changes_s, cancelled, progress, preview=preview)
    problems = _problems(jobs, CELLS_PER_WIDTH, np.float64)
    if method == "mto":
        joint = joint_problem(problems, problems[-1].misfit)
        removal = JointRemoval([problem.operator for problem in problems])
        time_s = damped_lsmr(joint, blocks=removal.blocks, cancelled=cancelled).time_s
        return JointTimes(tuple(time_s[block] for block in removal.blocks))
    target, times = problems[-1].misfit.target, []
    for index, problem in enumerate(problems):
        left = replace(problem, misfit=replace(problem.misfit, target=target))
        times.append(damped_lsmr(left, extend=True, cancelled=cancelled).time_s)
        target = left.residual(times[-1])
        progress((index + 1) / len(problems))
    return JointTimes(tuple(times))


def _ours(
    jobs: Sequence[PlanningJob], changes_s: float, cancelled: Cancelled, progress: Share, *, preview: bool
) -> JointTimes:
    coarse, fine = (
        joint_problem(problems, problems[-1].misfit)
        for problems in (
            _problems(jobs, per_width, np.float32) for per_width in (COARSE_CELLS_PER_WIDTH, CELLS_PER_WIDTH)
        )
    )
    on_pixels = JointRemoval(ideal_operators(jobs))
    options = jobs[-1].options
    aim = _dwell_aim(options.aim, changes_s, float(fine.lower_s.sum()))

    def residual_nm(time_s: FloatArray) -> float:
        return jobs[-1].rms_nm(on_pixels(time_s))

    regularisation, start_s = Regularisation(options.tikhonov), fine.lower_s
    if aim.max_residual_nm is not None:
        # The motion is to leave what is asked for: a margin is kept for it, and a quarter of one to save time within.
        allowed_nm = aim.max_residual_nm / (1 + aim.margin if options.loop else 1.0)
        aim = replace(aim, max_residual_nm=allowed_nm)
        regularisation, start_s = smoothest(
            coarse, residual_nm, allowed_nm / (1 + 0.25 * aim.margin), start_s, regularisation, cancelled
        )
    found = aim_at(
        coarse if preview else fine,
        residual_nm,
        aim,
        start_s=start_s,
        coarse=None if preview else coarse,
        regularisation=regularisation,
        effort=Effort.affordable(coarse if preview else fine, ROUNDS),
        cancelled=cancelled,
        progress=progress,
    )
    asked_nm = options.aim.max_residual_nm
    if asked_nm is not None and found.chosen.rms_nm > asked_nm * (1 + 1e-6):
        raise LimitsError(
            f"plan: the best residual of these tools and paths is about {found.floor.rms_nm:.4g} nm RMS, "
            f"more than the {asked_nm:g} nm allowed",
            "allow a larger residual, or add a narrower tool",
        )
    return JointTimes(
        tuple(found.chosen.time_s[block] for block in on_pixels.blocks),
        found.chosen.price_nm2_s,
        regularisation.smoothing * fine.curvature(),
    )


def _dwell_aim(aim: Aim, changes_s: float, shortest_s: float) -> Aim:
    """Aim for the dwell times alone: what changes of tools take of a limit on the total time is gone."""
    if aim.max_time_s is None:
        return aim
    if changes_s + shortest_s > aim.max_time_s:
        raise LimitsError(
            f"plan: these paths take the machines at least {shortest_s:.1f} s and changes of tools {changes_s:.1f} s, "
            f"more than {aim.max_time_s:g} s together",
            "allow more time, leave a tool out, or choose larger intervals",
        )
    return replace(aim, max_time_s=aim.max_time_s - changes_s)


def _problems(jobs: Sequence[PlanningJob], per_width: int, precision: Precision) -> list[DwellProblem]:
    """Problems of all jobs on the same cells, which the narrowest tool can resolve."""
    last = jobs[-1]
    cell = cell_size(last.surface, last.influence, per_width)
    return [
        job.ideal_problem(
            make_misfit(job.surface, job.target.clear_aperture, job.influence, job.options.remove, cell), precision
        )
        for job in jobs
    ]
