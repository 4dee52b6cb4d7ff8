"""The pictures of a plan and of its run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ibfctl.planning.as_run import AsRun
from ibfctl.planning.plan import Plan, Prediction
from ibfctl.planning.sequence import PlanSequence
from ibfctl.planning.spectra import spectra
from ibfctl.report.curves import draw_spectra
from ibfctl.report.panels import draw_panels, new_figure, save, signed_scale
from ibfctl.report.preview import figures_of, map_panel
from ibfctl.schedule.certificate import axis_cubics

FloatArray = NDArray[np.float64]

_SAMPLES_PER_SEGMENT = 4
_POINTS_PER_IN = 72.0
_PM_PER_NM = 1e3
_INK = "#1f3b5c"
_LIMIT = "#b2182b"


def draw_plan(plan: Plan, folder: Path) -> list[Path]:
    """Write the pictures of a plan: the map, the dwell times, the velocities and the spectra; return their paths."""
    paths = [folder / "dwell.png", folder / "velocities.png"]
    _draw_dwell(plan, paths[0])
    _draw_velocities(plan, paths[1])
    if plan.surface is None or plan.prediction is None:
        return paths
    initial = plan.prediction.initial_nm
    panel = map_panel(plan.surface, initial, f"Before: {figures_of(initial)}", "height / nm", signed_scale(initial))
    draw_panels(folder / "map.png", [panel], plan.options.clear_aperture)
    draw_spectra(spectra(plan.prediction, plan.surface.pixel_mm), folder / "psd.png")
    return [folder / "map.png", *paths, folder / "psd.png"]


def draw_run(plan: Plan | PlanSequence, as_run: AsRun | None, folder: Path) -> list[Path]:
    """Write the picture of the residuals, ideal, executed and as run, on one scale; return its path."""
    if plan.surface is None or plan.prediction is None or as_run is None:
        return []
    prediction: Prediction = plan.prediction
    residuals = (
        ("Ideal (dwell points)", prediction.ideal_residual_nm),
        ("Executed (quantised cubics)", prediction.executed_residual_nm),
        ("As run (trace of the controller)", as_run.residual_nm),
    )
    scale = signed_scale(*(values for _, values in residuals))
    panels = [
        map_panel(plan.surface, values, f"{title}: {figures_of(values)}", "residual / nm", scale)
        for title, values in residuals
    ]
    difference_pm = _PM_PER_NM * np.where(
        prediction.clear_aperture, as_run.removal_nm - prediction.executed_removal_nm, np.nan
    )
    title = f"Removal as run minus executed: {_PM_PER_NM * as_run.rms_difference_nm:.2f} pm RMS"
    scale = signed_scale(difference_pm)
    panels.append(map_panel(plan.surface, difference_pm, title, "difference / pm", scale))
    options = plan.options if isinstance(plan, Plan) else plan.plans[0].options
    draw_panels(folder / "residuals.png", panels, options.clear_aperture)
    return [folder / "residuals.png"]


def _draw_dwell(plan: Plan, path: Path) -> None:
    figure = new_figure(_height_in(plan) + 0.9)
    axis = figure.subplots()
    time_ms = 1e3 * plan.dwell.time_s
    title = f"Dwell time per step: {plan.dwell.time_s.sum():.1f} s in {time_ms.size} steps"
    nodes_mm = np.column_stack([plan.path.x_mm, plan.path.y_mm])
    _draw_along(figure, axis, nodes_mm, plan.options.spacing_mm[0], time_ms, title, "dwell time / ms")
    axis.set_xlabel("x / mm")
    save(figure, path)


def _draw_velocities(plan: Plan, path: Path) -> None:
    map_in = _height_in(plan)
    figure = new_figure(map_in + 5.2)
    top, *traces = figure.subplots(3, 1, height_ratios=[map_in, 1.7, 1.7])
    nodes_mm = np.column_stack(plan.options.placement.inverse(_nodes_mm(plan, "x"), _nodes_mm(plan, "y")))
    speed_mm_s = np.hypot(*np.diff(nodes_mm, axis=0).T) / (plan.program.time_samples * plan.program.sample_period_s)
    _draw_along(
        figure, top, nodes_mm, plan.options.spacing_mm[0], speed_mm_s, "Mean speed of every segment", "speed / (mm/s)"
    )
    top.set_xlabel("x / mm")
    time_s = _sample_times(plan)
    for axis, coordinate in zip(traces, ("x", "y"), strict=True):
        limits = plan.machine.axis_of(coordinate)
        velocity = _velocity(plan, coordinate)
        axis.plot(time_s, velocity, color=_INK, linewidth=0.6)
        letter = plan.machine.letter_of(coordinate)
        peak = float(np.abs(velocity).max())
        axis.set_title(
            f"Axis {letter} ({coordinate}): peak {peak:.1f} mm/s, limit {limits.v_max_mm_s:g} mm/s",
            loc="left",
            fontsize=10.5,
        )
        if peak > 0.3 * limits.v_max_mm_s:
            for sign in (-1, 1):
                axis.axhline(sign * limits.v_max_mm_s, color=_LIMIT, linewidth=0.9, linestyle=(0, (5, 3)))
        axis.set_ylabel(f"v{coordinate} / (mm/s)")
        axis.margins(x=0)
        axis.grid(color="0.9", linewidth=0.6)
        axis.set_axisbelow(True)
    traces[-1].set_xlabel("time / s")
    save(figure, path)


def _draw_along(
    figure: Figure, axis: Any, nodes_mm: FloatArray, width_mm: float, values: FloatArray, title: str, label: str
) -> None:
    """Draw one value per segment as the colour of a band along it, `width_mm` wide; nodes are (n + 1, 2)."""
    axis.set_xlim(nodes_mm[:, 0].min() - 0.5 * width_mm, nodes_mm[:, 0].max() + 0.5 * width_mm)
    axis.set_ylim(nodes_mm[:, 1].min() - 0.5 * width_mm, nodes_mm[:, 1].max() + 0.5 * width_mm)
    axis.set_aspect("equal")
    lines = LineCollection(
        list(np.stack([nodes_mm[:-1], nodes_mm[1:]], axis=1)), cmap="viridis", capstyle="butt", antialiaseds=False
    )
    lines.set_array(values)
    low, high = np.percentile(values, [0.5, 99.5])
    lines.set_clim(low, high)
    axis.add_collection(lines)
    axis.set_title(title, loc="left", fontsize=10.5)
    axis.set_ylabel("y / mm")
    bar = figure.colorbar(lines, ax=axis, pad=0.015, fraction=0.03, aspect=12, extend=_extend(values, low, high))
    bar.set_label(label)
    figure.draw_without_rendering()
    points_per_mm = axis.get_window_extent().width / figure.dpi * _POINTS_PER_IN / np.ptp(axis.get_xlim())
    lines.set_linewidth(1.05 * width_mm * points_per_mm)


def _extend(values: FloatArray, low: float, high: float) -> str:
    return {(False, False): "neither", (True, False): "min", (False, True): "max", (True, True): "both"}[
        bool(values.min() < low), bool(values.max() > high)
    ]


def _height_in(plan: Plan) -> float:
    return float(np.clip(7.6 * np.ptp(plan.path.y_mm) / max(np.ptp(plan.path.x_mm), 1e-9), 1.3, 7.0))


def _nodes_mm(plan: Plan, coordinate: str) -> FloatArray:
    axis = plan.program.axis_of(coordinate)
    counts = axis.start_counts + np.concatenate([[0], np.cumsum(axis.increment_counts)])
    return np.asarray(counts / axis.counts_per_mm)


def _sample_times(plan: Plan) -> FloatArray:
    time_s = plan.program.time_samples * plan.program.sample_period_s
    start_s = np.concatenate([[0.0], np.cumsum(time_s)[:-1]])
    share = np.arange(_SAMPLES_PER_SEGMENT) / _SAMPLES_PER_SEGMENT
    return np.asarray((start_s[:, None] + time_s[:, None] * share).ravel())


def _velocity(plan: Plan, coordinate: str) -> FloatArray:
    axis = plan.program.axis_of(coordinate)
    cubics = axis_cubics(plan.program, axis)
    share = np.arange(_SAMPLES_PER_SEGMENT) / _SAMPLES_PER_SEGMENT
    return np.asarray((cubics.velocity(cubics.time_s[:, None] * share) / axis.counts_per_mm).ravel())
