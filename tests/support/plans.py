"""Plans that hold a program and nothing else."""

from __future__ import annotations

import numpy as np

from ibfctl.machine.program import PvtProgram
from ibfctl.path.tool_path import ToolPath
from ibfctl.planning.options import PlanOptions
from ibfctl.planning.plan import DwellPlan, Plan
from ibfctl.schedule.certificate import Certificate
from support.programs import machine


def plan_of(job: PvtProgram) -> Plan:
    points = np.zeros(len(job))
    nodes = np.zeros(len(job) + 1)
    return Plan(
        machine=machine(),
        options=PlanOptions(),
        path=ToolPath(nodes, nodes),
        dwell=DwellPlan(points, points, points),
        program=job,
        certificate=Certificate(()),
        surface=None,
        influence=None,
        prediction=None,
        inputs={},
        planning_time_s=0.0,
    )
