"""A plan of two tools that is made in a moment: a part of 12 x 8 mm, some 40 s of motion."""

from __future__ import annotations

from ibfctl.machine.description import read_machine
from ibfctl.machine.shipped import shipped_machine
from ibfctl.planning.options import PlanOptions
from ibfctl.planning.sequence import PlanSequence
from ibfctl.planning.several import plan_sequence
from ibfctl.planning.tool import Tool
from ibfctl.surface.influence import gaussian
from ibfctl.surface.map import SurfaceMap
from support.small_job import small_height_nm


def two_tools(wide_nm_s: float = 12.0, narrow_nm_s: float = 12.0) -> PlanSequence:
    machine = read_machine(shipped_machine("simulator"))
    tools = [
        Tool(
            gaussian(fwhm_mm, peak_nm_s, 1.25 * fwhm_mm, 0.25),
            machine,
            PlanOptions(pitch_mm=pitch_mm, step_mm=pitch_mm, loop=False),
        )
        for fwhm_mm, pitch_mm, peak_nm_s in ((3.0, 1.5, wide_nm_s), (1.6, 0.8, narrow_nm_s))
    ]
    return plan_sequence(SurfaceMap.centred(small_height_nm(), 0.25), tools)
