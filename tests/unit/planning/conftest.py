"""A plan put together by hand: everything that a plan file holds, without the planner."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ibfctl.machine.description import read_machine
from ibfctl.machine.shipped import shipped_machine
from ibfctl.path.raster import raster
from ibfctl.planning.options import PlanOptions
from ibfctl.planning.plan import DwellPlan, InputFile, Plan, Prediction, Round
from ibfctl.schedule.scheduler import schedule
from ibfctl.surface.influence import gaussian
from ibfctl.surface.map import Rectangle, SurfaceMap


@pytest.fixture(scope="session")
def hand_made_plan() -> Plan:
    random = np.random.default_rng(3)
    machine = read_machine(shipped_machine("simulator"))
    turned = machine.axes["A"].model_copy(update={"direction": -1, "counts_per_mm": 3276.8})
    machine = machine.model_copy(update={"axes": {**machine.axes, "A": turned}})
    path = raster(Rectangle(-4.05, 4, -3, 3), 1.0, 0.7)
    dwell_s = 0.1 + random.uniform(size=path.segments)
    dwell_s[3] = 4.5
    scheduled = schedule(path, dwell_s, machine, 0.05, stretch=True)
    height_nm = random.normal(size=(20, 30))
    height_nm[3:5, 7:9] = np.nan
    surface = SurfaceMap(height_nm, 0.25, -3.6, -2.4)
    mask = np.isfinite(height_nm)
    fields = [np.where(mask, random.normal(size=height_nm.shape), np.nan) for _ in range(3)]
    return Plan(
        machine,
        PlanOptions(path=Path("nodes.csv"), clear_aperture=Rectangle(-1.0, 1.0, -2.0, 2.0), remove="piston"),
        path,
        DwellPlan(path.dwell_x_mm, path.dwell_y_mm, dwell_s),
        scheduled.program,
        scheduled.certificate,
        surface,
        gaussian(1.0, 5.0, 2.0, 0.25),
        Prediction(mask, fields[0], fields[1], random.normal(size=height_nm.shape), fields[2]),
        (Round(0.3, 12.0, accepted=True), Round(0.2, 12.1, accepted=False)),
        {"map": InputFile("größe.npz", "ab" * 32), "machine": InputFile("simulator", "cd" * 32)},
        1.25,
    )
