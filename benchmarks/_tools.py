"""Several tools on one part: the set-ups of Ke et al. 2022 (Opt. Express 30) on made surfaces.

The paper's maps are not public, so only the order of its results can be compared. Of the simulation it gives the
full widths of the Gaussian tools and their intervals, the size of the part and the speed; removal rates are ours. Of
the experiment it gives all but the map and the shapes of the tools, which are paraboloids here.

The surfaces are parts of random ones whose power spectral density falls with a power of the frequency, as that of
polished surfaces does: each narrower tool then finds something to do. On a surface of low orders and little else what
the offset of the times leaves would decide, and not what the tools can reach.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks._planning import stages
from ibfctl.machine.description import MachineDescription
from ibfctl.planning.options import Aim, PlanOptions
from ibfctl.planning.sequence import Method, PlanSequence
from ibfctl.planning.several import plan_sequence
from ibfctl.planning.tool import Tool
from ibfctl.surface.influence import InfluenceFunction, gaussian
from ibfctl.surface.levelling import Levelling
from ibfctl.surface.map import SurfaceMap

ACCELERATION_MM_S2 = 1000.0


@dataclass(frozen=True)
class Setup:
    """A square part and its finest pixels, its surface, tools by size, interval and peak rate, the machine's speed.

    Tools are Gaussian where their full widths at half maximum are given, and paraboloids elsewhere. The power spectral
    density of the surface falls with the power `decay` of the frequency.
    """

    size_mm: float
    finest_mm: float
    rms_nm: float
    decay: float
    seed: int
    diameter_mm: tuple[float, ...]
    interval_mm: tuple[float, ...]
    peak_nm_s: tuple[float, ...]
    v_max_mm_s: float
    fwhm_mm: tuple[float, ...] | None = None

    def surface(self, pixel_mm: float) -> SurfaceMap:
        """Make the surface on pixels of a multiple of the finest: averages of the same heights."""
        pixels = round(self.size_mm / self.finest_mm)
        # A part of a periodic surface twice as large has nothing periodic.
        noise = np.fft.rfft2(np.random.default_rng(self.seed).normal(size=(2 * pixels, 2 * pixels)))
        frequency = np.hypot(np.fft.fftfreq(2 * pixels)[:, None], np.fft.rfftfreq(2 * pixels))
        frequency[0, 0] = np.inf
        height_nm = np.fft.irfft2(noise * frequency ** (-self.decay / 2))[:pixels, :pixels]
        level = Levelling.over(np.ones(height_nm.shape, dtype=bool), "tilt")
        height_nm = level(height_nm.ravel()).reshape(height_nm.shape)
        cell = round(pixel_mm / self.finest_mm)
        averaged = height_nm.reshape(pixels // cell, cell, pixels // cell, cell).mean(axis=(1, 3))
        return SurfaceMap.centred(averaged * (self.rms_nm / averaged.std()), pixel_mm)

    def influence(self, number: int, pixel_mm: float) -> InfluenceFunction:
        """Make a tool."""
        radius_mm, peak_nm_s = 0.5 * self.diameter_mm[number], self.peak_nm_s[number]
        if self.fwhm_mm is not None:
            return gaussian(self.fwhm_mm[number], peak_nm_s, radius_mm, pixel_mm)
        half = int(np.ceil(radius_mm / pixel_mm - 1e-9))
        place_mm = pixel_mm * np.arange(-half, half + 1)
        share = (place_mm[:, None] ** 2 + place_mm**2) / radius_mm**2
        return InfluenceFunction(peak_nm_s * np.maximum(1 - share, 0), pixel_mm)

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
                self.influence(number, pixel_mm),
                machine,
                PlanOptions(pitch_mm=interval_mm, step_mm=interval_mm, scan_axis="y", aim=aim, loop=loop),
            )
            for number, interval_mm in enumerate(self.interval_mm)
        ]

    def plan(
        self, surface: SurfaceMap, method: Method, aim: Aim | None = None, *, limited: bool = True, loop: bool = True
    ) -> PlanSequence:
        """Plan all tools on a surface of this set-up."""
        tools = self.tools(surface.pixel_mm, aim or Aim(), limited=limited, loop=loop)
        return plan_sequence(surface, tools, method=method)


# Sizes of the tools follow from the intervals by the paper's Eq. 9.
SIMULATION = Setup(
    200.0, 0.5, 100.0, 3.7, 1, (60.0, 40.0, 16.0), (10.5, 7.0, 2.8), (60.0, 40.0, 30.0), 50.0, (24.0, 16.0, 6.0)
)
EXPERIMENT = Setup(60.0, 0.25, 45.42, 4.0, 4, (12.0, 8.0, 5.0), (2.0, 1.5, 1.0), (327.5, 114.8, 97.6), 50.0)


def slopes_s_mm(sequence: PlanSequence) -> Sequence[float]:
    """RMS slope of each tool's dwell times (the paper's Eq. 6)."""
    return [float(tool["slope_rms_s_mm"]) for tool in sequence.summary()["tools"]]  # type: ignore[attr-defined]
