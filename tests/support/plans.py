"""Plans that hold a program and nothing else."""

from __future__ import annotations

import numpy as np

from ibfctl.machine.program import PvtProgram
from ibfctl.path.tool_path import ToolPath
from ibfctl.planning.job import corridor_of
from ibfctl.planning.options import PlanOptions
from ibfctl.planning.plan import DwellPlan, Plan
from ibfctl.schedule.certificate import Certificate, certify
from support.programs import machine

OPTIONS = PlanOptions(pitch_mm=1.0, step_mm=1.0)


def nodes_mm(job: PvtProgram, coordinate: str) -> np.ndarray:
    axis = job.axis_of(coordinate)
    return (axis.start_counts + np.concatenate([[0], np.cumsum(axis.increment_counts)])) / axis.counts_per_mm


def plan_of(job: PvtProgram) -> Plan:
    """A plan whose path are the program's own nodes, certified for what the program keeps."""
    path = ToolPath(*(nodes_mm(job, coordinate) for coordinate in "xy"))
    checks = certify(job, machine(), path, job.time_s, np.arange(len(job)), corridor_of(OPTIONS)).checks
    return Plan(
        machine=machine(),
        options=OPTIONS,
        path=path,
        dwell=DwellPlan(path.dwell_x_mm, path.dwell_y_mm, job.time_s),
        program=job,
        certificate=Certificate(tuple(check for check in checks if check.passed)),
        surface=None,
        influence=None,
        prediction=None,
        inputs={},
        planning_time_s=0.0,
    )
