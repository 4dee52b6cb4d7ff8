"""Several tools on one part: the set-ups of Ke et al. 2022 (Opt. Express 30) on made surfaces.

The paper's maps are not public, so only the order of its results can be compared. Of the simulation it gives the
Gaussian tools and their intervals, the size of the part and the speed; removal rates are ours. Of the experiment it
gives all but the shapes of the tools, which are Gaussian here with a full width of 0.4 of their size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from benchmarks._planning import stages
from ibfctl.machine.description import MachineDescription
from ibfctl.planning.options import Aim, PlanOptions
from ibfctl.planning.sequence import Method, PlanSequence
from ibfctl.planning.several import plan_sequence
from ibfctl.planning.tool import Tool
from ibfctl.surface.influence import gaussian
from ibfctl.surface.map import SurfaceMap

ACCELERATION_MM_S2 = 1000.0


@dataclass(frozen=True)
class Setup:
    """A square part, tools by full width, size, interval and peak rate, and the top speed of the machine."""

    size_mm: float
    rms_nm: float
    fwhm_mm: tuple[float, ...]
    diameter_mm: tuple[float, ...]
    interval_mm: tuple[float, ...]
    peak_nm_s: tuple[float, ...]
    v_max_mm_s: float

    def surface(self, pixel_mm: float) -> SurfaceMap:
        """Make a surface: low orders, and noise as fine as the smallest tool can hardly correct."""
        pixels = round(self.size_mm / pixel_mm)
        y, x = np.mgrid[-1 : 1 : pixels * 1j, -1 : 1 : pixels * 1j]
        height_nm = x**2 + y**2 + 0.3 * x * y + 0.2 * np.cos(4 * x + 1) * np.cos(3 * y)
        height_nm /= height_nm.std()
        # The same noise whatever the pitch of the pixels.
        coarse = np.random.default_rng(7).normal(size=(200, 200))
        noise = ndimage.zoom(coarse, pixels / 200, order=1, mode="nearest", grid_mode=True)
        for width_mm, share in ((0.4 * self.fwhm_mm[-1], 0.02), (self.fwhm_mm[-1], 0.08), (3 * self.fwhm_mm[-1], 0.3)):
            smooth = ndimage.gaussian_filter(noise, width_mm / pixel_mm, mode="reflect")
            height_nm = height_nm + share * smooth / smooth.std()
        return SurfaceMap.centred(height_nm * (self.rms_nm / height_nm.std()), pixel_mm)

    def machine(self, *, limited: bool = True) -> MachineDescription:
        """Return stages with the top speed of the set-up, or with limits that nobody feels."""
        machine = stages()
        if not limited:
            return machine.without_limits()
        limits = {"v_max_mm_s": self.v_max_mm_s, "a_max_mm_s2": ACCELERATION_MM_S2}
        axes = {letter: axis.model_copy(update=limits) for letter, axis in machine.axes.items()}
        return machine.model_copy(update={"axes": axes})

    def tools(self, pixel_mm: float, aim: Aim, *, limited: bool = True, loop: bool = True) -> list[Tool]:
        """Return the tools on the pitch of a map, scanning along y as in the paper."""
        machine = self.machine(limited=limited)
        return [
            Tool(
                gaussian(fwhm_mm, peak_nm_s, 0.5 * diameter_mm, pixel_mm),
                machine,
                PlanOptions(pitch_mm=interval_mm, step_mm=interval_mm, scan_axis="y", aim=aim, loop=loop),
            )
            for fwhm_mm, diameter_mm, interval_mm, peak_nm_s in zip(
                self.fwhm_mm, self.diameter_mm, self.interval_mm, self.peak_nm_s, strict=True
            )
        ]

    def plan(
        self, surface: SurfaceMap, method: Method, aim: Aim | None = None, *, limited: bool = True, loop: bool = True
    ) -> PlanSequence:
        """Plan all tools on a surface of this set-up."""
        tools = self.tools(surface.pixel_mm, aim or Aim(), limited=limited, loop=loop)
        return plan_sequence(surface, tools, method=method)


# Sizes of the tools follow from the intervals by the paper's Eq. 9.
SIMULATION = Setup(200.0, 100.0, (24.0, 16.0, 6.0), (60.0, 40.0, 16.0), (10.5, 7.0, 2.8), (60.0, 40.0, 30.0), 50.0)
EXPERIMENT = Setup(60.0, 45.42, (4.8, 3.2, 2.0), (12.0, 8.0, 5.0), (2.0, 1.5, 1.0), (327.5, 114.8, 97.6), 50.0)


def slopes_s_mm(sequence: PlanSequence) -> Sequence[float]:
    """RMS slope of each tool's dwell times (the paper's Eq. 6)."""
    return [float(tool["slope_rms_s_mm"]) for tool in sequence.summary()["tools"]]  # type: ignore[attr-defined]
