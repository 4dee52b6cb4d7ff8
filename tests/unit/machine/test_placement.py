"""Part to machine coordinates and back, and placements fitted to fiducials."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ibfctl.errors import InputError
from ibfctl.machine.placement import AS_MOUNTED, Placement, fit_placement

MM = st.floats(-500, 500)
PLACEMENTS = st.builds(Placement, MM, MM, st.floats(-360, 360), st.booleans())


def positions(count: int = 20, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-50, 50, (count, 2))


@settings(deadline=None)
@given(placement=PLACEMENTS)
def test_there_and_back_is_where_it_began_and_distances_stay(placement: Placement) -> None:
    x_mm, y_mm = positions().T
    there = placement(x_mm, y_mm)
    np.testing.assert_allclose(placement.inverse(*there), (x_mm, y_mm), atol=1e-9)
    np.testing.assert_allclose(np.hypot(np.diff(there[0]), np.diff(there[1])), np.hypot(np.diff(x_mm), np.diff(y_mm)))


def test_mirror_then_rotation_then_offset() -> None:
    one = np.array([1.0]), np.array([2.0])
    assert Placement(10, 20)(*one) == (11, 22)
    assert Placement(rotation_deg=90)(*one) == (-2, 1)
    assert Placement(mirrored=True)(*one) == (-1, 2)
    assert Placement(10, 20, 90, True)(*one) == (8, 19)


def test_a_part_that_stands_in_machine_coordinates_is_left_alone() -> None:
    x_mm, y_mm = positions().T
    assert AS_MOUNTED.as_mounted
    assert AS_MOUNTED(x_mm, y_mm)[0] is x_mm
    assert AS_MOUNTED.inverse(x_mm, y_mm)[1] is y_mm
    assert Placement(1.0).as_mounted is False
    assert Placement(1.0).turned is False


@settings(deadline=None)
@given(placement=PLACEMENTS, count=st.integers(2, 9))
def test_fiducials_without_error_give_the_placement_back(placement: Placement, count: int) -> None:
    part = positions(count, 7)
    machine = np.column_stack(placement(*part.T))
    found = fit_placement(part, machine, mirrored=placement.mirrored)
    np.testing.assert_allclose(found.matrix, placement.matrix, atol=1e-9)
    np.testing.assert_allclose(found(*part.T), machine.T, atol=1e-9)
    assert found.fiducial_rms_mm == pytest.approx(0.0, abs=1e-9)
    assert found.fiducial_max_mm == pytest.approx(0.0, abs=1e-9)


def test_the_fit_is_the_best_of_all_placements() -> None:
    random = np.random.default_rng(3)
    part = positions(6)
    machine = np.column_stack(Placement(30, -4, 17, True)(*part.T)) + random.normal(0, 0.01, (6, 2))
    found = fit_placement(part, machine, mirrored=True, limit_mm=0.1)
    assert found.rotation_deg == pytest.approx(17, abs=0.05)
    error_mm = np.hypot(*(np.array(found(*part.T)) - machine.T))
    assert found.fiducial_rms_mm == pytest.approx(np.sqrt((error_mm**2).mean()))
    assert found.fiducial_max_mm == pytest.approx(error_mm.max())
    for change in (
        Placement(found.offset_x_mm + 1e-3, found.offset_y_mm, found.rotation_deg, True),
        Placement(found.offset_x_mm, found.offset_y_mm - 1e-3, found.rotation_deg, True),
        Placement(found.offset_x_mm, found.offset_y_mm, found.rotation_deg + 1e-3, True),
    ):
        other_mm = np.hypot(*(np.array(change(*part.T)) - machine.T))
        assert (other_mm**2).sum() > (error_mm**2).sum()


def test_a_fiducial_that_is_off_is_named() -> None:
    part = positions(5)
    machine = part + np.array([5.0, 5.0])
    machine[3] += [0.0, 1.0]
    with pytest.raises(InputError, match=r"number 4 is 0\.\d+ mm from") as caught:
        fit_placement(part, machine)
    assert "--fiducial-limit-mm" in caught.value.hint


@pytest.mark.parametrize("mirrored", [False, True])
def test_the_wrong_handedness_is_said(mirrored: bool) -> None:
    part = positions(4)
    machine = np.column_stack(Placement(3, 4, 30, mirrored)(*part.T))
    with pytest.raises(InputError) as caught:
        fit_placement(part, machine, mirrored=not mirrored)
    assert caught.value.hint.startswith("the part is mirrored" if mirrored else "the part is not mirrored")


@pytest.mark.parametrize(
    ("part", "machine", "said"),
    [
        ([[0, 0]], [[0, 0]], "fewer than two"),
        ([[0, 0], [1, 1]], [[0, 0]], "fewer than two"),
        ([[0, 0], [0, 0]], [[0, 0], [1, 1]], "one place"),
        ([[0, 0], [9, 9]], [[1, 1], [1, 1]], "one place"),
        ([[0, 0], [9, float("nan")]], [[1, 1], [1, 5]], "no finite number"),
        ([[0, 0], [10, 0]], [[0, 0], [254, 0]], "number"),
    ],
)
def test_fiducials_that_fix_nothing_are_refused(part: list, machine: list, said: str) -> None:
    with pytest.raises(InputError, match=said):
        fit_placement(np.array(part, dtype=float), np.array(machine, dtype=float))


def test_an_offset_that_is_none_is_refused() -> None:
    with pytest.raises(InputError, match="no finite number"):
        Placement(float("nan"))
