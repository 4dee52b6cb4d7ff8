"""Which tools: every subset is compared, and the one that serves the aim is chosen."""

from __future__ import annotations

import numpy as np
import pytest

from ibfctl.errors import CancelledError, InputError
from ibfctl.machine.description import read_machine
from ibfctl.machine.shipped import shipped_machine
from ibfctl.planning.options import Aim, PlanOptions
from ibfctl.planning.suggest import Suggestion, suggest_tools
from ibfctl.planning.tool import Tool
from ibfctl.surface.influence import gaussian
from ibfctl.surface.levelling import rms
from ibfctl.surface.map import SurfaceMap

MACHINE = read_machine(shipped_machine("simulator"))
CHANGE_S = 15.0


def surface() -> SurfaceMap:
    y, x = np.mgrid[-1:1:40j, -1:1:56j]
    return SurfaceMap.centred(30 * (x**2 + 0.6 * y**2) + 2 * np.cos(9 * x + 1) * np.cos(7 * y), 0.25)


def tools(aim: Aim) -> list[Tool]:
    return [
        Tool(gaussian(fwhm_mm, 12.0, 1.2 * fwhm_mm, 0.25), MACHINE, PlanOptions(pitch_mm=pitch_mm, aim=aim))
        for fwhm_mm, pitch_mm in ((2.0, 1.0), (4.0, 2.0))
    ]


@pytest.fixture(scope="module")
def suggested() -> dict[float, Suggestion]:
    return {
        worth: suggest_tools(surface(), tools(Aim(seconds_per_nm=worth)), tool_change_s=CHANGE_S)
        for worth in (1.0, 1000.0)
    }


def test_every_subset_is_tried_the_widest_tool_first(suggested: dict[float, Suggestion]) -> None:
    for suggestion in suggested.values():
        assert {subset.tools for subset in suggestion.subsets} == {(1,), (2,), (2, 1)}
        residuals = [subset.residual_nm for subset in suggestion.subsets]
        assert residuals == sorted(residuals, reverse=True)
        for subset in suggestion.subsets:
            changes_s = CHANGE_S * (len(subset.tools) - 1)
            assert subset.total_time_s == pytest.approx(sum(subset.tool_time_s) + changes_s)


def test_what_a_nanometre_is_worth_decides(suggested: dict[float, Suggestion]) -> None:
    for worth, suggestion in suggested.items():
        cost_s = {subset.tools: subset.total_time_s + worth * subset.residual_nm for subset in suggestion.subsets}
        assert cost_s[suggestion.chosen.tools] == min(cost_s.values())
    # Where time is dear the wide tool alone is enough; where residual is, the narrow one follows it.
    assert suggested[1.0].chosen.tools == (2,)
    assert suggested[1000.0].chosen.tools == (2, 1)


def test_a_margin_takes_the_shortest_of_the_best() -> None:
    suggestion = suggest_tools(surface(), tools(Aim(0.3)))
    best_nm = min(subset.residual_nm for subset in suggestion.subsets)
    within = [subset for subset in suggestion.subsets if subset.residual_nm <= 1.3 * best_nm]
    assert suggestion.chosen in within
    assert suggestion.chosen.total_time_s == min(subset.total_time_s for subset in within)


def test_bands_add_up_to_the_residual(suggested: dict[float, Suggestion]) -> None:
    suggestion = suggested[1000.0]
    for subset in suggestion.subsets:
        assert np.hypot.reduce([band.rms_nm for band in subset.bands]) == pytest.approx(subset.residual_nm)
    level_nm = np.hypot.reduce([band.rms_nm for band in suggestion.initial])
    assert 0.5 * rms(surface().height_nm - surface().height_nm.mean()) < level_nm
    assert suggestion.initial[0].longest_mm == np.inf
    assert suggestion.initial[-1].shortest_mm == 0
    # The wide tool alone leaves the waves that the narrow one takes.
    alone = {subset.tools: subset.bands[1].rms_nm for subset in suggestion.subsets}
    assert alone[(2,)] > 2 * alone[(2, 1)]


def test_a_subset_is_outdone_where_another_is_no_worse_in_both(suggested: dict[float, Suggestion]) -> None:
    for suggestion in suggested.values():
        assert not suggestion.chosen.outdone
        for subset in suggestion.subsets:
            better = [
                other
                for other in suggestion.subsets
                if other is not subset
                and other.residual_nm <= subset.residual_nm
                and other.total_time_s <= subset.total_time_s
            ]
            assert subset.outdone == bool(better)


def test_no_tool_and_too_many_tools_are_refused() -> None:
    with pytest.raises(InputError, match="no tool"):
        suggest_tools(surface(), [])
    with pytest.raises(InputError, match="too many subsets"):
        suggest_tools(surface(), 4 * tools(Aim()))


def test_the_comparison_can_be_cancelled() -> None:
    with pytest.raises(CancelledError):
        suggest_tools(surface(), tools(Aim()), cancelled=lambda: True)
