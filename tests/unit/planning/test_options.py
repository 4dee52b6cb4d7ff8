"""What is chosen where the user chooses nothing."""

from __future__ import annotations

import pytest

from ibfctl.errors import InputError
from ibfctl.planning.options import PlanOptions


def test_lines_and_steps_are_a_quarter_of_the_tools_width_apart_where_none_are_given() -> None:
    assert PlanOptions().spaced(2.0).spacing_mm == (0.5, 0.5)


def test_a_step_follows_the_pitch_and_both_may_be_given() -> None:
    assert PlanOptions(pitch_mm=0.3).spaced(2.0).spacing_mm == (0.3, 0.3)
    assert PlanOptions(step_mm=0.2).spaced(2.0).spacing_mm == (0.5, 0.2)
    assert PlanOptions(pitch_mm=0.3, step_mm=0.2).spaced(2.0).spacing_mm == (0.3, 0.2)


def test_spacings_that_nobody_chose_are_not_made_up() -> None:
    with pytest.raises(InputError, match="not chosen"):
        _ = PlanOptions().spacing_mm
