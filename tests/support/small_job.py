"""A job that is planned in a moment: a part of 12 x 8 mm and a tool of 4 mm."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ibfctl.machine.shipped import shipped_machine

TIF = "gaussian:fwhm_mm=1.6,peak_nm_s=4,radius_mm=2"
PITCH = ("--pitch-mm", "1", "--step-mm", "1")


@dataclass(frozen=True)
class SmallJob:
    folder: Path
    map: Path
    machine: Path

    def plan_arguments(self, output: Path, *more: str) -> list[str]:
        return ["plan", str(self.map), TIF, "--machine", str(self.machine), *PITCH, "-o", str(output), *more]


def small_height_nm() -> np.ndarray:
    y, x = np.mgrid[-1:1:32j, -1:1:48j]
    return 8 * x**2 + 5 * y**2 * x + 2 * np.cos(5 * x)


def write_small_job(folder: Path) -> SmallJob:
    path = folder / "map.npz"
    np.savez(path, height_nm=small_height_nm(), pixel_mm=0.25)
    return SmallJob(folder, path, shipped_machine("simulator"))
