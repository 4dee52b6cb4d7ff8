"""Figures in words, for people; `--json` gives the same figures to programs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ibfctl.machine.description import MachineDescription
    from ibfctl.planning.plan import CurvePoint

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
        ("path", path(figures["path"])),
        *placement(figures.get("placement")),
        *([("dwell times", dwell_bounds(figures))] if "dwell_bounds" in figures else []),
        ("peak velocity", per_axis(figures["peak_velocity_mm_s"], "mm/s")),
        ("peak acceleration", per_axis(figures["peak_acceleration_mm_s2"], "mm/s²")),
        *(smoothing_lines(figures) if "smoothing" in figures else []),
        ("certificate", certificate(figures["certificate"])),
        ("planning time", f"{figures['planning_time_s']:.2f} s"),
    ]
    return lines


def smoothing_lines(figures: Mapping[str, Any]) -> Lines:
    """Say what rounding the corners did."""
    rounding = figures["smoothing"]
    sharp_s, lowers = rounding["sharp_total_time_s"], " and ".join(rounding["lowers"])
    return [
        (
            "rounded corners",
            f"{rounding['corners']}, at most {rounding['deviation_mm']:.4g} mm off the programmed path "
            f"(tolerance {rounding['corner_tolerance_mm']:g} mm)",
        ),
        (
            "with sharp corners",
            f"{rounding['sharp_executed_rms_nm']:.3f} nm RMS, "
            f"{per_axis(rounding['sharp_peak_acceleration_mm_s2'], 'mm/s²')}, {sharp_s:.1f} s",
        ),
        ("rounding lowers", f"{lowers} in the same time" if lowers else "neither residual nor acceleration"),
    ]


def trade_off_table(points: Sequence[CurvePoint]) -> list[str]:
    """Return the curve of residual against time, the chosen point marked."""
    lines = [f"{'dwell time / s':>16}{'residual / nm RMS':>20}"]
    for point in points:
        mark = "  chosen" if point.chosen else ""
        lines.append(f"{point.total_time_s:>16.2f}{point.rms_nm:>20.4f}{mark}")
    return lines


def tool_table(figures: Mapping[str, Any]) -> list[str]:
    """Return the tools of a plan in the order in which they run."""
    lines = [f"{'tool':<6}{'width':>9}{'pitch':>9}{'time':>11}{'slope RMS':>11}{'residual':>11}  influence function"]
    lines.append(f"{'':<6}{'mm':>9}{'mm':>9}{'s':>11}{'s/mm':>11}{'nm RMS':>11}")
    for number, tool in enumerate(figures["tools"], 1):
        lines.append(
            f"{number:<6}{tool['full_width_mm']:>9.3g}{tool['pitch_mm']:>9.3g}{tool['total_time_s']:>11.1f}"
            f"{tool['slope_rms_s_mm']:>11.3g}{tool['executed_rms_nm']:>11.3f}  {tool['influence'] or ''}"
        )
    return lines


def subset_table(figures: Mapping[str, Any], names: Sequence[str]) -> list[str]:
    """Return the subsets of tools by falling residual, the chosen one marked, with what is left in each band."""
    heads = [f"{band['longest_mm']:.3g}-{band['shortest_mm']:.3g}" for band in figures["initial"]]
    lines = [f"{number}  {name}" for number, name in enumerate(names, 1)]
    lines += ["", f"{'tools':<14}{'residual':>10}{'time':>11}" + "".join(f"{head:>13}" for head in heads)]
    lines.append(f"{'':<14}{'nm RMS':>10}{'s':>11}" + f"{'mm':>13}" * len(heads))
    rows = [("before", None, None, figures["initial"], "")]
    for subset in figures["subsets"]:
        mark = "  chosen" if subset["chosen"] else "  outdone" if subset["outdone"] else ""
        tools = " ".join(str(number) for number in subset["tools"])
        rows.append((tools, subset["residual_nm"], subset["total_time_s"], subset["bands"], mark))
    for tools, residual_nm, time_s, bands, mark in rows:
        total_nm = residual_nm if residual_nm is not None else sum(band["rms_nm"] ** 2 for band in bands) ** 0.5
        time = "" if time_s is None else f"{time_s:.1f}"
        left = "".join(f"{band['rms_nm']:>13.3f}" for band in bands)
        lines.append(f"{tools:<14}{total_nm:>10.3f}{time:>11}{left}{mark}")
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


def comparison_lines(figures: Mapping[str, Any]) -> list[str]:
    """Return the table of a comparison: one block for each path, one row for each scheduler."""
    lines: list[str] = []
    for name, compared in figures["paths"].items():
        lines += [
            *([""] if lines else []),
            f"{name}: {path(compared['path'])}; ideal residual {compared['ideal_rms_nm']:.3f} nm RMS",
            f"{'scheduler':<24}{'overshoot':>11}{'excursion':>11}{'jump max':>10}{'jump RMS':>10}"
            f"{'peak x':>9}{'peak y':>9}{'jerk':>10}{'run time':>10}{'residual':>10}",
            f"{'':<24}{'mm':>11}{'mm':>11}{'mm/s²':>10}{'mm/s²':>10}{'mm/s²':>9}{'mm/s²':>9}{'mm/s³':>10}{'s':>10}"
            f"{'nm RMS':>10}",
        ]
        for scheduler, row in compared["schedulers"].items():
            peak = row["peak_acceleration_mm_s2"]
            lines.append(
                f"{scheduler:<24}{row['overshoot_mm']:>11.4f}{row['excursion_mm']:>11.4f}"
                f"{row['largest_acceleration_jump_mm_s2']:>10.0f}{row['rms_acceleration_jump_mm_s2']:>10.0f}"
                f"{peak['x']:>9.0f}{peak['y']:>9.0f}{max(row['peak_jerk_mm_s3'].values()):>10.0f}"
                f"{row['total_time_s']:>10.1f}{row['executed_rms_nm']:>10.4f}"
            )
    return lines


def method_lines(figures: Mapping[str, Any]) -> list[str]:
    """Return the table of methods for dwell times: one block for each path, one row for each method."""
    columns = (
        ("ideal_rms_nm", "ideal", "nm RMS", 10, "10.4f"),
        ("executed_rms_nm", "executed", "nm RMS", 10, "10.4f"),
        ("total_time_s", "run time", "s", 11, "11.1f"),
        ("slope_rms_s_mm", "slope RMS", "s/mm", 11, "11.4g"),
        ("peak_speed_mm_s", "peak speed", "mm/s", 12, "12.1f"),
        ("planning_s", "planning", "s", 10, "10.2f"),
    )
    lines: list[str] = []
    for name, methods in figures["methods"].items():
        lines += [
            *([""] if lines else []),
            f"{name:<24}" + "".join(f"{heading:>{width}}" for _, heading, _, width, _ in columns),
            f"{'':<24}" + "".join(f"{unit:>{width}}" for _, _, unit, width, _ in columns),
        ]
        for method, row in methods.items():
            lines.append(f"{method:<24}" + "".join(f"{row[key]:>{form}}" for key, _, _, _, form in columns))
    return lines


def placement(figures: Mapping[str, Any] | None) -> Lines:
    """Say how the part stands on the machine, and how well the fiducials agree."""
    if figures is None:
        return []
    mirrored = ", mirrored" if figures["mirrored"] else ""
    place = f"origin at {figures['offset_x_mm']:.4g}, {figures['offset_y_mm']:.4g} mm"
    lines: Lines = [("part on the machine", f"{place}, rotated by {figures['rotation_deg']:.4g}°{mirrored}")]
    if figures["fiducial_max_mm"] is not None:
        off = f"{figures['fiducial_rms_mm']:.2g} mm RMS, at most {figures['fiducial_max_mm']:.2g} mm"
        lines.append(("fiducials off by", off))
    return lines


def tolerance_lines(figures: Mapping[str, Any]) -> list[str]:
    """Return the tables of what runs leave, and of what every cause does alone."""
    names = list(figures["rms_nm"]["percentiles"])
    lines = [f"{'residual / nm':<16}{'predicted':>11}{'mean':>11}" + "".join(f"{name:>11}" for name in names)]
    for name in ("rms", "pv"):
        spread = figures[f"{name}_nm"]
        values = [figures[f"predicted_{name}_nm"], spread["mean"], *spread["percentiles"].values()]
        lines.append(f"{name.upper():<16}" + "".join(f"{value:>11.4f}" for value in values))
    lines += ["", f"{'cause alone':<16}{'RMS / nm':>11}{'share':>11}"]
    for cause, alone in figures["causes"].items():
        lines.append(f"{cause.replace('_', ' '):<16}{alone['rms_nm']:>11.4f}{alone['share']:>11.1%}")
    return lines


def path(figures: Mapping[str, Any]) -> str:
    """Say the figures of a path."""
    gap = figures["largest_gap_mm"]
    covered = "" if gap is None else f"largest gap {gap:.3g} mm, "
    step, corner = figures["shortest_step_mm"], figures["sharpest_corner_deg"]
    return f"{covered}shortest step {step:.3g} mm, sharpest corner {corner:.0f}°"


def dwell_bounds(figures: Mapping[str, Any]) -> str:
    """Say the bounds of the dwell times, and what to do where the longest ones are not long enough."""
    bounds = figures["dwell_bounds"]
    said = f"from {bounds['shortest_s']:.3g} s to {bounds['longest_s']:.3g} s"
    if not bounds["steps_at_longest"]:
        return said
    return f"{said}; {bounds['steps_at_longest']} steps as long as --v-min-mm-s allows: a lower one leaves less"


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
