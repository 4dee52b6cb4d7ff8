"""Bounds of the dwell times: where they come from, that plans keep them as executed, and jobs that they forbid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ibfctl.errors import InputError, LimitsError
from ibfctl.machine.description import MachineDescription, read_machine
from ibfctl.machine.shipped import shipped_machine
from ibfctl.path.tool_path import ToolPath
from ibfctl.planning.bounds import step_bounds
from ibfctl.planning.job import prepare
from ibfctl.planning.options import Aim, PlanOptions
from ibfctl.planning.plan import Plan
from ibfctl.planning.planner import make_plan
from ibfctl.schedule.scheduler import shortest_times
from ibfctl.surface.influence import gaussian
from ibfctl.surface.map import SurfaceMap
from tests.support.small_job import small_height_nm

MACHINE = read_machine(shipped_machine("simulator"))
SURFACE = SurfaceMap.centred(small_height_nm(), 0.25)
TOOL = gaussian(1.6, 4.0, 2.0, 0.1)
OPTIONS = PlanOptions(pitch_mm=1.0, step_mm=1.0)
PAIR_S = 2 * MACHINE.sample_period_s


def executed_s(plan: Plan) -> np.ndarray:
    """Times of the segments of the path, from the integers of the program: here no segment is split."""
    assert len(plan.program) == plan.path.segments
    return np.asarray(plan.program.time_s)


def limited(v_max_mm_s: float, a_max_mm_s2: float) -> MachineDescription:
    update = {"v_max_mm_s": v_max_mm_s, "a_max_mm_s2": a_max_mm_s2}
    return MACHINE.model_copy(update={"axes": {k: axis.model_copy(update=update) for k, axis in MACHINE.axes.items()}})


@pytest.mark.parametrize("path", ["raster", "maze"])
@pytest.mark.parametrize(("v_min_mm_s", "kind"), [(1.0, "machine"), (8.0, "machine"), (2.0, "ramp")])
@pytest.mark.parametrize("remove", ["tilt", "none"])
def test_the_executed_times_keep_their_bounds(path: str, v_min_mm_s: float, kind: str, remove: str) -> None:
    # 2 nm on average are there to be removed.
    options = replace(OPTIONS, path=path, v_min_mm_s=v_min_mm_s, dwell_bounds=kind, remove=remove)  # type: ignore[arg-type]
    plan = make_plan(SurfaceMap.centred(small_height_nm() - 1.0, 0.25), TOOL, MACHINE, options)
    bounds, times_s = step_bounds(plan.path, MACHINE, options), executed_s(plan)
    assert plan.certificate.passed
    assert (times_s >= bounds.lower_s - 1e-9).all()
    assert (times_s <= bounds.upper_s + 1e-9).all()
    assert (times_s <= plan.path.length_mm / v_min_mm_s + 1e-9).all()


def test_what_the_longest_times_do_not_remove_stays_and_is_told() -> None:
    free, bound = (make_plan(SURFACE, TOOL, MACHINE, replace(OPTIONS, v_min_mm_s=v)).summary() for v in (None, 1.0))
    assert "dwell_bounds" not in free
    assert bound["executed_rms_nm"] > 1.5 * free["executed_rms_nm"]  # type: ignore[operator]
    told = bound["dwell_bounds"]
    assert told["longest_s"] == pytest.approx(1.0)  # type: ignore[index]
    assert told["steps_at_longest"] > 10  # type: ignore[index]
    assert told["steps_at_shortest"] > 10  # type: ignore[index]


def test_without_a_slowest_speed_the_machines_shortest_times_are_the_only_bounds() -> None:
    path = ToolPath(np.array([0.0, 1.0, 2.0, 2.0]), np.array([0.0, 0.0, 0.0, 1.0]))
    bounds = step_bounds(path, MACHINE, OPTIONS)
    assert bounds.lower_s == pytest.approx(shortest_times(path, MACHINE))
    assert np.isinf(bounds.upper_s).all()


def test_the_bounds_of_ramps_are_the_papers() -> None:
    # Zhang et al., Eq. 22: 200 to 4000 mm/min and 0.3 g over 2.09 mm give 0.0416 to 0.422 s.
    path = ToolPath(2.09 * np.arange(40.0), np.zeros(40))
    options = replace(OPTIONS, v_min_mm_s=200 / 60, dwell_bounds="ramp")
    bounds = step_bounds(path, limited(4000 / 60, 0.3 * 9800), options)
    inner = slice(5, -5)  # the ends start and stop at rest, which the paper leaves aside
    assert bounds.lower_s[inner] == pytest.approx(0.0416, abs=PAIR_S)
    assert bounds.upper_s[inner] == pytest.approx(0.422, abs=PAIR_S)


def test_the_fastest_speed_of_ramps_is_no_more_than_advised() -> None:
    path = ToolPath(0.5 * np.arange(40.0), np.zeros(40))
    bounds = step_bounds(path, MACHINE, replace(OPTIONS, v_min_mm_s=1.0, dwell_bounds="ramp"))
    fastest = 0.8 * np.sqrt(2 * 0.5 * 2000)
    lost_mm = (fastest - 1.0) ** 2 / (2 * 2000)
    assert bounds.lower_s[20] == pytest.approx((0.5 + lost_mm) / fastest, abs=PAIR_S)
    assert bounds.upper_s[20] == pytest.approx((0.5 - lost_mm) / 1.0, abs=PAIR_S)


@pytest.mark.parametrize(
    ("choice", "said"),
    [
        ({"v_min_mm_s": 16.0}, r"step to node 17 .* at least 0\.07812 s, but at 16 mm/s or more at most 0\.0625"),
        ({"v_min_mm_s": 4.0, "dwell_min_s": 0.3}, r"220 of 220 steps cannot be"),
        ({"v_min_mm_s": 4.0, "aim": Aim(max_residual_nm=0.3)}, "more than the 0.3 nm allowed"),
    ],
)
def test_bounds_that_exclude_each_other_are_refused_with_figures(choice: dict[str, object], said: str) -> None:
    with pytest.raises(LimitsError, match=said) as caught:
        make_plan(SURFACE, TOOL, MACHINE, replace(OPTIONS, **choice))  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


def test_a_repeated_node_is_a_stop_that_a_slowest_speed_forbids() -> None:
    path = ToolPath(np.array([0.0, 1.0, 1.0, 2.0]), np.zeros(4))
    for kind in ("machine", "ramp"):
        with pytest.raises(LimitsError, match=r"step to node 2 .* repeated nodes"):
            step_bounds(path, MACHINE, replace(OPTIONS, v_min_mm_s=1.0, dwell_bounds=kind))  # type: ignore[arg-type]


def test_more_than_the_longest_times_remove_is_refused_where_nothing_is_free() -> None:
    options = replace(OPTIONS, remove="none", v_min_mm_s=1.0)
    deep = SurfaceMap.centred(small_height_nm() + 100.0, 0.25)
    with pytest.raises(LimitsError, match=r"to be removed on average, but at 1 mm/s or more .* at most"):
        make_plan(deep, TOOL, MACHINE, options)


def test_times_that_the_machine_lengthens_too_far_are_refused() -> None:
    job = prepare(SURFACE, TOOL, MACHINE, replace(OPTIONS, v_min_mm_s=1.0))
    times_s = np.full(job.path.segments, 0.5)
    job.check_times(times_s)
    times_s[7] = 1.25
    with pytest.raises(LimitsError, match=r"1 of 220 steps .* to node 8, takes 1\.25 s instead of 1 s"):
        job.check_times(times_s)


@pytest.mark.parametrize(
    ("choice", "said"),
    [
        ({"v_min_mm_s": 0.0}, "v_min_mm_s"),
        ({"v_min_mm_s": -1.0}, "v_min_mm_s"),
        ({"v_min_mm_s": float("nan")}, "v_min_mm_s"),
        ({"dwell_bounds": "ramp"}, "give --v-min-mm-s"),
        ({"dwell_bounds": "ramp", "v_min_mm_s": 60.0}, "no range"),
    ],
)
def test_what_is_no_slowest_speed_is_refused(choice: dict[str, object], said: str) -> None:
    with pytest.raises(InputError, match=said):
        make_plan(SURFACE, TOOL, MACHINE, replace(OPTIONS, **choice))  # type: ignore[arg-type]
