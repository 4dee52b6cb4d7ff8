"""Every method for dwell times on every path: the public flat with two tools, and made jobs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks import _flat, public_data
from benchmarks._harness import Absent
from benchmarks._planning import made_map, made_tool, stages
from ibfctl.demo.job import demo_job
from ibfctl.planning.comparison import path_choices
from ibfctl.planning.options import MadePath, PlanOptions
from ibfctl.planning.side_by_side import MethodFigures, compare_methods
from ibfctl.surface.influence import InfluenceFunction
from ibfctl.surface.map import SurfaceMap
from ibfctl.surface.readers import read_influence

OURS = "ours"
PATHS: tuple[MadePath, ...] = ("raster", "maze", "random")
ROUND_PIXELS = 300
COLUMNS = {
    "ideal_rms_nm": ("ideal / nm RMS", ".3f"),
    "executed_rms_nm": ("executed / nm RMS", ".3f"),
    "total_time_s": ("run time / s", ".1f"),
    "slope_rms_s_mm": ("slope RMS / s/mm", ".3g"),
    "peak_speed_mm_s": ("peak / mm/s", ".1f"),
    "planning_s": ("planning / s", ".2f"),
}


@dataclass(frozen=True)
class Job:
    """A map, a tool, and what is chosen for both but the path."""

    surface: SurfaceMap
    influence: InfluenceFunction
    options: PlanOptions
    paths: tuple[MadePath, ...] = PATHS


def run() -> dict[str, Any]:
    """Compare all methods on all paths; one row each, and ours against the best of the others."""
    rows, ratios = [], []
    for name, job in _jobs():
        compared = compare_methods(job.surface, job.influence, stages(), path_choices(job.paths, job.options))
        for path, methods in compared.items():
            best_nm = min(figures.executed_rms_nm for method, figures in methods.items() if not method.startswith(OURS))
            ratios.append(methods[OURS].executed_rms_nm / best_nm)
            for method, figures in methods.items():
                rows.append([name, path, method, *_cells(figures)])
    return {
        "metrics": {
            "rows": len(rows),
            "paths": len(ratios),
            "median_residual_to_best_other": float(np.median(ratios)),
            "largest_residual_to_best_other": max(ratios),
        },
        "targets": {},
        "tables": [{"columns": ["job", "path", "method", *(title for title, _ in COLUMNS.values())], "rows": rows}],
    }


def _cells(figures: MethodFigures) -> list[str]:
    """Write the figures; a path that never goes straight on has no slope."""
    cells = [format(getattr(figures, key), form) for key, (_, form) in COLUMNS.items()]
    return [cell if cell != "0" else "–" for cell in cells]


def _jobs() -> Iterator[tuple[str, Job]]:
    try:
        flat, data = _flat.flat(), public_data.data_folder()
    except Absent:
        pass
    else:
        gaussian = _flat.FAST.influence(flat.pixel_mm)
        yield "public flat, 5 mm Gaussian", Job(flat, gaussian, PlanOptions(clear_aperture=_flat.APERTURE))
        jet = read_influence(data / "fluid_jet_tif.mat")
        yield "public flat, fluid jet", Job(flat, jet, PlanOptions(clear_aperture=public_data.APERTURE))
    made = demo_job()
    yield "made flat 92 x 16 mm", Job(made.surface, made.influence, made.options)
    surface = made_map(ROUND_PIXELS)
    outside = np.hypot(surface.x_mm, surface.y_mm[:, None]) > surface.x_mm[-1]
    disc = replace(surface, height_nm=np.where(outside, np.nan, surface.height_nm))
    yield "made disc of 30 mm", Job(disc, made_tool(), PlanOptions(pitch_mm=1.0, step_mm=1.0), (*PATHS, "spiral"))
