"""The picture of a map alone. It loads no planner: a preview must be there at once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ibfctl.report.panels import Panel, draw_panels, signed_scale
from ibfctl.surface.levelling import peak_to_valley, rms
from ibfctl.surface.map import SurfaceMap

FloatArray = NDArray[np.float64]

_PREVIEW_PIXELS = 700


def draw_map(surface: SurfaceMap, path: Path) -> None:
    """Write the picture of a map as measured, without its mean; of a large map every so many pixels."""
    height_nm = surface.height_nm - np.nanmean(surface.height_nm)
    step = -(-max(height_nm.shape) // _PREVIEW_PIXELS)
    shown_nm = height_nm[::step, ::step]
    panel = map_panel(surface, shown_nm, figures_of(height_nm), "height / nm", signed_scale(shown_nm))
    draw_panels(path, [panel], None)


def map_panel(surface: SurfaceMap, values: FloatArray, title: str, label: str, scale: tuple[float, float]) -> Panel:
    """Return the panel of values on the pixels of a map."""
    return Panel(title, values, surface.extent_mm, label, *scale)


def figures_of(values_nm: FloatArray) -> str:
    """Say RMS and PV of what is no NaN."""
    valid_nm = values_nm[np.isfinite(values_nm)]
    return f"{rms(valid_nm):#.3g} nm RMS, {peak_to_valley(valid_nm):#.3g} nm PV"
