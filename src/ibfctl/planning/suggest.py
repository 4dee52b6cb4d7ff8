"""Which tools to use on a part: every subset of them, by residual, time and spatial frequencies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import combinations, pairwise

import numpy as np
from numpy.typing import NDArray

from ibfctl.dwell.misfit import full_width_mm
from ibfctl.dwell.solver import Cancelled, never
from ibfctl.errors import CancelledError, InputError
from ibfctl.planning.job import PlanningJob
from ibfctl.planning.joint_dwell import ideal_operators, solve_jointly
from ibfctl.planning.planner import Progress
from ibfctl.planning.several import prepare_tools
from ibfctl.planning.tool import Tool
from ibfctl.surface.levelling import rms
from ibfctl.surface.map import SurfaceMap
from ibfctl.surface.psd import psd_radial

FloatArray = NDArray[np.float64]

# Six tools have 63 subsets.
MOST_TOOLS = 6


@dataclass(frozen=True)
class Band:
    """RMS of what lies between two spatial wavelengths; infinite and zero at the ends."""

    longest_mm: float
    shortest_mm: float
    rms_nm: float


@dataclass(frozen=True)
class Subset:
    """What some of the tools could do together.

    Attributes
    ----------
    tools
        Their numbers, counted from one in the order in which they were given; here the widest first.
    residual_nm
        RMS that the dwell times leave at their dwell points.
    tool_time_s
        Dwell time of each tool.
    total_time_s
        Of all, with changes of tools.
    bands
        The residual by spatial wavelength.
    outdone
        Whether another subset leaves no more in no longer time.
    """

    tools: tuple[int, ...]
    residual_nm: float
    tool_time_s: tuple[float, ...]
    total_time_s: float
    bands: tuple[Band, ...]
    outdone: bool


@dataclass(frozen=True)
class Suggestion:
    """All subsets of the tools.

    Attributes
    ----------
    initial
        The map before, by spatial wavelength.
    subsets
        By falling residual.
    chosen
        The one that serves the aim best.
    """

    initial: tuple[Band, ...]
    subsets: tuple[Subset, ...]
    chosen: Subset

    def summary(self) -> dict[str, object]:
        """Return the JSON form of `ibfctl tools suggest --json`."""
        return {
            "initial": [asdict(band) for band in self.initial],
            "subsets": [asdict(subset) | {"chosen": subset is self.chosen} for subset in self.subsets],
        }


def suggest_tools(
    surface: SurfaceMap,
    tools: Sequence[Tool],
    *,
    tool_change_s: float = 0.0,
    progress: Progress | None = None,
    cancelled: Cancelled = never,
) -> Suggestion:
    """Solve dwell times for every subset of some tools, on coarse cells and without scheduling.

    Parameters
    ----------
    surface, tools, tool_change_s
        As for `plan_sequence`; the aim is a margin, or what a nanometre is worth. With a margin, the shortest of the
        subsets is chosen whose residual is within it of the best.

    Raises
    ------
    InputError
        If there is no tool, or more than can be tried.
    LimitsError, CancelledError
        As `plan_sequence` does.
    """
    if len(tools) > MOST_TOOLS:
        raise InputError(f"{len(tools)} tools have too many subsets", f"give {MOST_TOOLS} at most")
    numbered = sorted(enumerate(tools, 1), key=lambda pair: full_width_mm(pair[1].influence), reverse=True)
    jobs = prepare_tools(surface, [tool for _, tool in numbered])
    widths_mm = [full_width_mm(tool.influence) for _, tool in numbered]
    indices = [subset for count in range(1, len(jobs) + 1) for subset in combinations(range(len(jobs)), count)]
    found: list[Subset] = []
    for done, subset in enumerate(indices):
        if cancelled():
            raise CancelledError("the comparison was cancelled", "start it again when wanted")
        if progress is not None:
            progress(f"trying {len(subset)} of {len(jobs)} tools", done / len(indices))
        numbers = tuple(numbered[index][0] for index in subset)
        found.append(_solved([jobs[index] for index in subset], numbers, tool_change_s, widths_mm, cancelled))
    if progress is not None:
        progress("compared", 1.0)
    subsets = tuple(sorted((_marked(subset, found) for subset in found), key=lambda subset: -subset.residual_nm))
    aim, best_nm = tools[0].options.aim, min(subset.residual_nm for subset in subsets)
    worth = aim.seconds_per_nm
    if worth is not None:
        chosen = min(subsets, key=lambda subset: subset.total_time_s + worth * subset.residual_nm)
    else:
        within = [subset for subset in subsets if subset.residual_nm <= (1 + aim.margin) * best_nm]
        chosen = min(within, key=lambda subset: subset.total_time_s)
    target = jobs[0].target
    initial = _bands(target.height_map_nm(), surface.pixel_mm, widths_mm)
    return Suggestion(initial, subsets, chosen)


def _solved(
    jobs: Sequence[PlanningJob],
    numbers: tuple[int, ...],
    tool_change_s: float,
    widths_mm: Sequence[float],
    cancelled: Cancelled,
) -> Subset:
    changes_s = tool_change_s * (len(jobs) - 1)
    times = solve_jointly(jobs, "ours", changes_s, cancelled, preview=True).time_s
    removal_nm = sum(operator(time_s) for operator, time_s in zip(ideal_operators(jobs), times, strict=True))
    residual_nm = jobs[0].target.residual_map_nm(np.asarray(removal_nm))
    tool_time_s = tuple(float(time_s.sum()) for time_s in times)
    return Subset(
        numbers,
        rms(residual_nm[jobs[0].target.clear_aperture]),
        tool_time_s,
        sum(tool_time_s) + changes_s,
        _bands(residual_nm, jobs[0].surface.pixel_mm, widths_mm),
        outdone=False,
    )


def _marked(subset: Subset, others: Sequence[Subset]) -> Subset:
    """Return a subset that knows whether another leaves no more in no longer time."""
    outdone = any(
        other is not subset and other.residual_nm <= subset.residual_nm and other.total_time_s <= subset.total_time_s
        for other in others
    )
    return replace(subset, outdone=outdone)


def _bands(height_nm: FloatArray, pixel_mm: float, widths_mm: Sequence[float]) -> tuple[Band, ...]:
    """RMS of a map (ny, nx) between the full widths of the tools, from its radial power spectral density."""
    spectrum = psd_radial(height_nm, pixel_mm)
    edges_mm = [np.inf, *sorted(set(widths_mm), reverse=True), 0.0]
    with np.errstate(divide="ignore"):
        wavelength_mm = 1 / spectrum.frequency_per_mm
    bands = []
    for longest_mm, shortest_mm in pairwise(edges_mm):
        inside = (wavelength_mm <= longest_mm) & (wavelength_mm > shortest_mm)
        power_nm2 = float((spectrum.density * spectrum.weight)[inside].sum())
        bands.append(Band(float(longest_mm), float(shortest_mm), float(np.sqrt(power_nm2))))
    return tuple(bands)
