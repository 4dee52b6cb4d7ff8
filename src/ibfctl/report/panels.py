"""Maps on paper: panels on one length scale, colour bars with units, the same colours where compared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import patches
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ibfctl.files import atomic_path
from ibfctl.surface.map import Rectangle
from ibfctl.surface.regions import Circle, Polygon, Region

FloatArray = NDArray[np.float64]

WIDTH_IN = 10.0
_DPI = 160
_MIN_PANEL_IN, _MAX_PANEL_IN = 1.3, 7.0
_PANEL_WIDTH_SHARE = 0.78
_TITLE_IN = 0.45
_NO_DATA = "0.9"


@dataclass(frozen=True)
class Panel:
    """One image.

    Attributes
    ----------
    title
        What it shows, with its figures.
    values : (ny, nx) float64
        NaN where nothing is to be drawn.
    extent
        Outer edges of the image on the part.
    label
        Quantity and unit at the colour bar.
    low, high
        Ends of the colour scale.
    diverging
        True for signed quantities, drawn around a neutral middle.
    """

    title: str
    values: FloatArray
    extent: Rectangle
    label: str
    low: float
    high: float
    diverging: bool = True


def signed_scale(*values: FloatArray, percentile: float = 99.5) -> tuple[float, float]:
    """Return one scale around zero that holds nearly all values of all arrays that are compared."""
    sizes = [float(np.nanpercentile(np.abs(array), percentile)) for array in values if np.isfinite(array).any()]
    top = max([*sizes, np.finfo(float).tiny])
    return -top, top


def draw_panels(path: Path, panels: Sequence[Panel], aperture: Region | None) -> None:
    """Write stacked panels as a PNG; the clear aperture is outlined."""
    widest = max(panel.extent.x1_mm - panel.extent.x0_mm for panel in panels)
    heights = [
        float(
            np.clip(
                WIDTH_IN * _PANEL_WIDTH_SHARE * (panel.extent.y1_mm - panel.extent.y0_mm) / widest,
                _MIN_PANEL_IN,
                _MAX_PANEL_IN,
            )
        )
        for panel in panels
    ]
    figure = new_figure(sum(heights) + (_TITLE_IN + 0.25) * len(panels) + 0.4)
    axes = figure.subplots(len(panels), 1, squeeze=False, height_ratios=heights)[:, 0]
    for axis, panel in zip(axes, panels, strict=True):
        draw_panel(figure, axis, panel, aperture)
    axes[-1].set_xlabel("x / mm")
    save(figure, path)


def draw_panel(figure: Figure, axis: Any, panel: Panel, aperture: Region | None) -> None:
    """Draw one image with its colour bar into a pair of axes."""
    edges = panel.extent
    axis.set_facecolor(_NO_DATA)
    image = axis.imshow(
        panel.values,
        origin="lower",
        extent=(edges.x0_mm, edges.x1_mm, edges.y0_mm, edges.y1_mm),
        vmin=panel.low,
        vmax=panel.high,
        cmap="RdBu_r" if panel.diverging else "viridis",
        interpolation="nearest",
        aspect="equal",
    )
    outline = _outline(aperture)
    if outline is not None:
        axis.add_patch(outline)
    axis.set_title(panel.title, loc="left", fontsize=10.5)
    axis.set_ylabel("y / mm")
    bar = figure.colorbar(image, ax=axis, pad=0.015, fraction=0.03, aspect=12, extend=_extend(panel))
    bar.set_label(panel.label)


def _outline(region: Region | None) -> patches.Patch | None:
    """Outline of a region; a mask shows itself by what is not drawn outside it."""
    style: dict[str, Any] = {"fill": False, "edgecolor": "0.15", "linewidth": 0.9, "linestyle": (0, (5, 3))}
    match region:
        case Rectangle(x0_mm, x1_mm, y0_mm, y1_mm):
            return patches.Rectangle((x0_mm, y0_mm), x1_mm - x0_mm, y1_mm - y0_mm, **style)
        case Circle(x_mm, y_mm, radius_mm):
            return patches.Circle((x_mm, y_mm), radius_mm, **style)
        case Polygon(points_mm):
            return patches.Polygon(points_mm, **style)
    return None


def new_figure(height_in: float) -> Figure:
    """Make an empty figure of the common width; drawn without a display."""
    figure = Figure(figsize=(WIDTH_IN, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save(figure: Figure, path: Path) -> None:
    """Write the figure as a PNG, completely or not at all."""
    with atomic_path(path) as partial:
        figure.savefig(partial, dpi=_DPI, format="png")


def _extend(panel: Panel) -> str:
    low = bool(np.nanmin(panel.values) < panel.low) if np.isfinite(panel.values).any() else False
    high = bool(np.nanmax(panel.values) > panel.high) if np.isfinite(panel.values).any() else False
    return {(False, False): "neither", (True, False): "min", (False, True): "max", (True, True): "both"}[low, high]
