"""The top speed that is advised for a path."""

import numpy as np
import pytest

from ibfctl.machine.description import read_machine
from ibfctl.machine.shipped import shipped_machine
from ibfctl.path.tool_path import ToolPath
from ibfctl.planning.advice import advised_speeds_mm_s

MACHINE = read_machine(shipped_machine("simulator"))  # x 2000 mm/s², y 1000 mm/s²


@pytest.mark.parametrize(
    ("direction", "acceleration"), [((1.0, 0.0), 2000.0), ((0.0, 1.0), 1000.0), ((0.6, 0.8), 1250.0)]
)
def test_the_weaker_axis_in_the_direction_of_the_usual_step_decides(
    direction: tuple[float, float], acceleration: float
) -> None:
    along_mm = np.array([0.0, 0.5, 1.0, 1.0, 1.5, 4.0])  # a repeated node and one long step
    path = ToolPath(direction[0] * along_mm, direction[1] * along_mm)
    top = np.sqrt(2 * 0.5 * acceleration)
    assert advised_speeds_mm_s(path, MACHINE) == pytest.approx((0.6 * top, 0.8 * top))


def test_a_path_that_does_not_move_has_no_speed() -> None:
    nowhere = np.zeros(3)
    assert advised_speeds_mm_s(ToolPath(nowhere, nowhere), MACHINE) == (0.0, 0.0)
