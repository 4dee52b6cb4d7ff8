"""The demo from seed to as-run residual, in a folder that holds every file of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ibfctl.demo.job import DemoJob
from ibfctl.files import save_npz
from ibfctl.jobs.inputs import InfluenceFile, MapFile
from ibfctl.jobs.plan_files import hashed, plan_files
from ibfctl.jobs.rehearsal import Rehearsal, rehearse
from ibfctl.planning.plan import Plan
from ibfctl.report.pictures import draw_plan, draw_run

Report = Callable[[str, float], None]


@dataclass(frozen=True)
class Demo:
    """What the demo leaves.

    Attributes
    ----------
    plan, rehearsal
        What was planned, and what was done.
    files
        Everything that was written, in order.
    """

    plan: Plan
    rehearsal: Rehearsal
    files: tuple[Path, ...]

    def summary(self) -> dict[str, Any]:
        """Return the figures of `plan` and of `simulate` in one object."""
        return {**self.plan.summary(), **self.rehearsal.summary()}


def run_demo(job: DemoJob, machine: Path, folder: Path, *, speed: float, on_progress: Report) -> Demo:
    """Write the job's files into `folder`, plan it, rehearse it at `speed`, and draw pictures."""
    folder.mkdir(parents=True, exist_ok=True)
    surface, influence = folder / "map.npz", folder / "tif.npz"
    save_npz(
        surface,
        height_nm=job.surface.height_nm,
        pixel_mm=job.surface.pixel_mm,
        x0_mm=job.surface.x0_mm,
        y0_mm=job.surface.y0_mm,
    )
    save_npz(influence, rate_nm_s=job.influence.rate_nm_s, pixel_mm=job.influence.pixel_mm)
    plan_path, run_path = folder / "plan.h5", folder / "run.h5"
    plan = plan_files(
        MapFile(str(surface)),
        InfluenceFile(str(influence)),
        machine,
        job.options,
        plan_path,
        on_progress=on_progress,
    )
    rehearsal = rehearse(plan, run_path, plan_file=hashed(plan_path), speed=speed, on_progress=on_progress)
    on_progress("pictures", 0.0)
    pictures = [*draw_plan(plan, folder), *draw_run(plan, rehearsal.as_run, folder)]
    on_progress("pictures", 1.0)
    return Demo(plan, rehearsal, (surface, influence, plan_path, run_path, *pictures))
