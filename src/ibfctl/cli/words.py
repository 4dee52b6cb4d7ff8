"""Figures in words, for people; `--json` gives the same figures to programs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ibfctl.machine.description import MachineDescription

Lines = list[tuple[str, str]]


def plan_lines(figures: Mapping[str, Any]) -> Lines:
    """Return names and values of a plan's summary."""
    lines: Lines = []
    if "initial_rms_nm" in figures:
        lines += [
            ("initial residual", residual(figures["initial_rms_nm"], figures["initial_pv_nm"])),
            ("ideal residual", residual(figures["ideal_rms_nm"], figures["ideal_pv_nm"])),
            ("executed residual", residual(figures["executed_rms_nm"], figures["executed_pv_nm"])),
        ]
    lines += [
        ("run time", f"{figures['total_time_s']:.1f} s"),
        ("nodes, segments", f"{figures['nodes']}, {figures['segments']}"),
        ("peak velocity", per_axis(figures["peak_velocity_mm_s"], "mm/s")),
        ("peak acceleration", per_axis(figures["peak_acceleration_mm_s2"], "mm/s²")),
        ("certificate", certificate(figures["certificate"])),
        ("planning time", f"{figures['planning_time_s']:.2f} s"),
    ]
    return lines


def run_lines(figures: Mapping[str, Any]) -> Lines:
    """Return names and values of a rehearsal's summary."""
    lines: Lines = []
    if figures["as_run_rms_nm"] is not None:
        lines += [
            ("as-run residual", residual(figures["as_run_rms_nm"], figures["as_run_pv_nm"])),
            ("as-run against executed", f"at most {figures['max_difference_nm']:.2g} nm"),
        ]
    lines += [
        ("segments executed", str(figures["segments_executed"])),
        ("position error at the end", per_axis(figures["final_position_error_counts"], "counts")),
        ("smallest buffer margin", f"{figures['minimum_buffer_margin_s']:.2f} s"),
        ("stop codes", per_axis(figures["stop_codes"], "")),
    ]
    return lines


def demo_table(figures: Mapping[str, Any], machine: MachineDescription) -> list[str]:
    """Return the table that ends the demo: residuals, motion against its limits, and the proofs."""
    lines = [f"{'residual':<12}{'RMS / nm':>12}{'PV / nm':>12}"]
    for stage in ("initial", "ideal", "executed", "as_run"):
        pv_nm = figures.get(f"{stage}_pv_nm")
        pv = f"{pv_nm:>12.2f}" if pv_nm is not None else ""
        lines.append(f"{stage.replace('_', '-'):<12}{figures[f'{stage}_rms_nm']:>12.4f}{pv}")
    lines += ["", f"{'axis':<12}{'peak':>12}{'limit':>12}"]
    for letter, axis in machine.axes.items():
        peaks = figures["peak_velocity_mm_s"][letter], figures["peak_acceleration_mm_s2"][letter]
        limits = (axis.v_max_mm_s, "mm/s"), (axis.a_max_mm_s2, "mm/s²")
        lines += [
            f"{f'{letter} ({axis.coordinate})':<12}{peak:>12.1f}{limit:>12.0f}  {unit}"
            for peak, (limit, unit) in zip(peaks, limits, strict=True)
        ]
    lines.append("")
    rows = [
        ("run time", f"{figures['total_time_s']:.1f} s"),
        ("segments", f"{figures['segments_executed']} of {figures['segments']} executed"),
        ("certificate", certificate(figures["certificate"])),
        ("as-run against executed", f"at most {figures['max_difference_nm']:.2g} nm"),
        ("position at the end", f"{per_axis(figures['final_position_error_counts'], 'counts')} off"),
        ("smallest buffer margin", f"{figures['minimum_buffer_margin_s']:.2f} s"),
        ("planning time", f"{figures['planning_time_s']:.2f} s"),
    ]
    width = max(len(name) for name, _ in rows)
    return [*lines, *(f"{name:<{width}}  {value}" for name, value in rows)]


def residual(rms_nm: float, pv_nm: float) -> str:
    """Say a residual."""
    return f"{rms_nm:.3f} nm RMS, {pv_nm:.2f} nm PV"


def per_axis(values: Mapping[str, float], unit: str) -> str:
    """Say one value per axis."""
    return f"{', '.join(f'{axis} {value:.6g}' for axis, value in values.items())} {unit}".rstrip()


def certificate(figures: Mapping[str, Any]) -> str:
    """Say whether every check passed, and which did not."""
    checks = figures["checks"]
    failed = [name for name, check in checks.items() if not check["passed"]]
    return f"FAILED: {', '.join(failed)}" if failed else f"passed ({len(checks)} checks)"
