"""What is to go: levelled heights, and a depth that every place must lose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ibfctl.errors import InputError, LimitsError
from ibfctl.machine.description import MachineDescription, read_machine
from ibfctl.machine.shipped import shipped_machine
from ibfctl.planning.options import PlanOptions
from ibfctl.planning.planner import make_plan
from ibfctl.planning.target import Target
from ibfctl.surface.influence import gaussian
from ibfctl.surface.map import SurfaceMap
from tests.support.small_job import small_height_nm

OPTIONS = PlanOptions(pitch_mm=1.0, step_mm=1.0, loop=False)
HEIGHT_NM = small_height_nm()
SURFACE = SurfaceMap.centred(HEIGHT_NM, 0.25)
TOOL = gaussian(1.6, 4.0, 2.0, 0.1)
MASK = np.ones(HEIGHT_NM.shape, dtype=bool)


@pytest.fixture(scope="module")
def machine() -> MachineDescription:
    return read_machine(shipped_machine("simulator"))


def target(**choices: object) -> Target:
    return Target.of(SURFACE, TOOL, MASK, replace(OPTIONS, **choices))  # type: ignore[arg-type]


@pytest.mark.parametrize("remove", ["none", "piston", "tilt", "power", "legendre:4", "zernike:9"])
def test_a_removal_like_the_target_leaves_nothing_and_free_terms_never_matter(remove: str) -> None:
    aim = target(remove=remove)
    wanted_nm = HEIGHT_NM - HEIGHT_NM.mean() if remove != "none" else HEIGHT_NM
    assert np.abs(aim.residual_nm(wanted_nm)).max() < 1e-9
    if remove != "none":
        assert np.abs(aim.residual_nm(wanted_nm + 17.0)).max() < 1e-9
    np.testing.assert_allclose(aim.height_map_nm(), aim.residual_map_nm(np.zeros(MASK.shape)))


@pytest.mark.parametrize("remove", ["piston", "tilt", "legendre:3"])
def test_an_extra_removal_is_what_the_lowest_place_loses(remove: str) -> None:
    aim = target(remove=remove, extra_removal_nm=12.0)
    free = target(remove=remove)
    assert np.array_equal(aim.height_nm, free.height_nm)
    # The map is smooth: its lowest cell is nearly its lowest pixel.
    assert aim.wanted_nm.min() == pytest.approx(12.0, abs=0.5)
    wanted_nm = aim.wanted_nm.reshape(MASK.shape)
    assert np.abs(aim.residual_nm(wanted_nm)).max() < 1e-9
    # Now the piston counts, and so does tilt: else some place might lose less.
    assert aim.residual_nm(wanted_nm - 3.0) == pytest.approx(3.0)
    tilt_nm = np.linspace(-5, 5, MASK.shape[1]) * np.ones(MASK.shape)
    np.testing.assert_allclose(aim.residual_nm(wanted_nm - tilt_nm), tilt_nm.ravel(), atol=1e-9)


def test_one_deep_pixel_does_not_set_the_depth() -> None:
    spiked = HEIGHT_NM.copy()
    spiked[7, 9] -= 500.0
    aim = Target.of(
        SurfaceMap.centred(spiked, 0.25), gaussian(8.0, 1.0, 8.0, 0.5), MASK, replace(OPTIONS, remove="none")
    )
    assert aim.depth_nm is None
    deep = Target.of(
        SurfaceMap.centred(spiked, 0.25),
        gaussian(8.0, 1.0, 8.0, 0.5),
        MASK,
        replace(OPTIONS, remove="piston", extra_removal_nm=5.0),
    )
    assert deep.depth_nm is not None
    assert deep.depth_nm < 40.0


def test_where_nothing_is_free_the_depth_comes_on_top() -> None:
    aim = target(remove="none", extra_removal_nm=4.0)
    np.testing.assert_allclose(aim.wanted_nm.reshape(MASK.shape), HEIGHT_NM + 4.0)


@pytest.mark.parametrize("depth_nm", [0.0, -1.0, float("nan"), float("inf")])
def test_a_depth_that_is_none_is_refused(depth_nm: float) -> None:
    with pytest.raises(InputError, match="extra removal"):
        target(extra_removal_nm=depth_nm)


def test_the_plan_removes_that_depth_everywhere_and_leaves_the_same_figure(machine: MachineDescription) -> None:
    plain, deep = (
        make_plan(SURFACE, TOOL, machine, replace(OPTIONS, extra_removal_nm=depth_nm)) for depth_nm in (None, 40.0)
    )
    assert plain.prediction is not None
    assert deep.prediction is not None
    levelled_nm = plain.prediction.initial_nm
    np.testing.assert_array_equal(deep.prediction.initial_nm, levelled_nm)
    wanted_nm = levelled_nm - levelled_nm.min() + 40.0
    removed_nm = deep.prediction.executed_removal_nm
    assert removed_nm.mean() == pytest.approx(wanted_nm.mean(), rel=0.02)
    assert removed_nm.min() > 30.0
    # What the lines of the raster leave grows with the depth.
    assert deep.summary()["executed_rms_nm"] < 0.005 * removed_nm.mean()
    assert deep.program.total_time_s > plain.program.total_time_s


def test_power_that_is_free_is_neither_planned_nor_counted(machine: MachineDescription) -> None:
    bent = SurfaceMap.centred(HEIGHT_NM + 10 * (SURFACE.x_mm**2 + SURFACE.y_mm[:, None] ** 2), 0.25)
    plain, free = (make_plan(surface, TOOL, machine, replace(OPTIONS, remove="power")) for surface in (SURFACE, bent))
    assert free.summary()["initial_rms_nm"] == pytest.approx(plain.summary()["initial_rms_nm"], rel=1e-3)
    assert free.program.total_time_s == pytest.approx(plain.program.total_time_s, rel=0.02)


def test_a_depth_that_the_slowest_speed_does_not_remove_is_refused(machine: MachineDescription) -> None:
    with pytest.raises(LimitsError, match="are to be removed on average"):
        make_plan(SURFACE, TOOL, machine, replace(OPTIONS, extra_removal_nm=1000.0, v_min_mm_s=2.0))
