"""Part programs: the path with its feed rates, the smoothing command with its tolerance, the predicted time."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ibfctl.machine.description import MachineDescription, read_machine
from ibfctl.machine.placement import Placement
from ibfctl.machine.shipped import shipped_machine
from ibfctl.path.maze import maze
from ibfctl.path.smoothing import drive_shares, smooth_corners
from ibfctl.planning.plan import Plan
from ibfctl.planning.planner import schedule_nodes
from ibfctl.report.exchange import write_exchange
from ibfctl.report.gcode import gcode_lines
from ibfctl.schedule.kinematics import time_corners
from ibfctl.schedule.kinematics_drive import drive_of
from ibfctl.surface.map import Rectangle

PATH = maze(Rectangle(0, 4, 0, 3), 0.5, seed=3)


@pytest.fixture(scope="module")
def machine() -> MachineDescription:
    return read_machine(shipped_machine("nsls2-ibf"))


@pytest.fixture(scope="module")
def plan(machine: MachineDescription) -> Plan:
    x_mm, y_mm = np.append(PATH.x_mm, PATH.x_mm[-1]), np.append(PATH.y_mm, PATH.y_mm[-1])
    dwell_s = 0.2 + 0.3 * np.random.default_rng(0).uniform(size=x_mm.size)
    dwell_s[0] = 0.0
    return schedule_nodes(x_mm, y_mm, dwell_s, machine)


def number(lines: list[str], pattern: str) -> float:
    (found,) = (match[1] for line in lines if (match := re.search(pattern, line)))
    return float(found)


def test_the_path_is_walked_in_its_dwell_times(plan: Plan) -> None:
    lines = list(gcode_lines(plan, "a plan"))
    start = next(line for line in lines if line.startswith("G0"))
    moves = np.array([[float(word[1:]) for word in line.split()[1:]] for line in lines if line.startswith("G1 ")])
    at = np.vstack([[float(word[1:]) for word in start.split()[1:]], moves[:, :2]])
    np.testing.assert_allclose(at, np.column_stack([PATH.x_mm, PATH.y_mm]), atol=1e-5)
    walked_s = 60 * np.hypot(*np.diff(at, axis=0).T) / moves[:, 2]
    np.testing.assert_allclose(walked_s, plan.dwell.time_s[:-1], rtol=1e-4)
    # The last node is repeated: the tool stands there.
    assert number(lines, r"^G4 F(.*)") == pytest.approx(plan.dwell.time_s[-1], abs=1e-4)
    assert lines[0] == "; a plan"
    assert lines[-1] == "M30"


def test_the_smoothing_command_has_the_tolerance_of_the_plan(plan: Plan) -> None:
    lines = list(gcode_lines(plan, ""))
    assert number(lines, r"^SOFT G642 CTOL=(.*)") == 0.025  # the corridor: 5 % of a step
    rounded = replace(plan, options=replace(plan.options, corner_tolerance_mm=0.01))
    assert number(list(gcode_lines(rounded, "")), r"^SOFT G642 CTOL=(.*)") == 0.01


def test_the_predicted_time_is_that_of_the_kinematic_model(plan: Plan, machine: MachineDescription) -> None:
    lines = list(gcode_lines(plan, ""))
    predicted_s = number(lines, r"^; predicted cycle time ([0-9.]+) s")
    corners = smooth_corners(PATH, 0.025, drive_shares(PATH))
    feed = PATH.length_mm / plan.dwell.time_s[:-1]
    timing = time_corners(corners, drive_of(machine), feed)
    assert predicted_s == pytest.approx(timing.cycle_time_s + plan.dwell.time_s[-1], abs=1e-3)
    deviation_mm = number(lines, r"^; corners are at most ([0-9.]+) mm")
    assert deviation_mm == pytest.approx(corners.largest_deviation_mm, abs=1e-4)
    # A slower drive takes longer than the plan, and is told so.
    weak = machine.model_copy(
        update={"axes": {letter: axis.model_copy(update={"a_max_mm_s2": 5.0}) for letter, axis in machine.axes.items()}}
    )
    slow_s = number(list(gcode_lines(replace(plan, machine=weak), "")), r"^; predicted cycle time ([0-9.]+) s")
    assert slow_s > 1.2 * plan.dwell.time_s.sum()


def test_the_part_program_is_in_the_machines_coordinates(plan: Plan) -> None:
    placed = replace(plan, options=replace(plan.options, placement=Placement(10.0, -5.0, 90.0)))
    start = next(line for line in gcode_lines(placed, "") if line.startswith("G0"))
    assert start == f"G0 X{10 - PATH.y_mm[0]:.5f} Y{-5 + PATH.x_mm[0]:.5f}"


def test_it_is_written_like_the_other_exports(plan: Plan, tmp_path: Path) -> None:
    write_exchange(plan, "gcode", "a plan", tmp_path / "plan.gcode")
    assert (tmp_path / "plan.gcode").read_text().splitlines() == list(gcode_lines(plan, "a plan"))


def test_a_machine_with_a_limit_of_the_jerk_is_taken_at_its_word(machine: MachineDescription) -> None:
    axes = {letter: axis.model_copy(update={"j_max_mm_s3": 9000.0}) for letter, axis in machine.axes.items()}
    limited = drive_of(machine.model_copy(update={"axes": axes}))
    assert limited.j_max_mm_s3 == (9000.0, 9000.0)
    assert limited.transition_j_max_mm_s3 == (6000.0, 6000.0)
    assert drive_of(machine).j_max_mm_s3 == (30_000.0, 15_000.0)
