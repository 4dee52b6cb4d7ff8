import csv

import numpy as np
import pytest

from ibfctl.machine.program import AxisProgram, PvtProgram
from ibfctl.report.exchange import FORMATS, exchange_lines


def _program(segments: int = 3) -> PvtProgram:
    step = np.arange(1, segments + 1)
    axes = {
        "A": AxisProgram(100 * step, 1000 * step, -500, 1000.0),
        "B": AxisProgram(-7 * step, -70 * step, 40, -100.0),
    }
    return PvtProgram(axes, {"x": "A", "y": "B"}, 2 * step, 1 / 1024)


def test_plain_csv_holds_counts_and_millimetres_of_every_node() -> None:
    rows = list(csv.DictReader(exchange_lines(_program(), "csv", "")))
    assert len(rows) == 4
    assert rows[0]["x_mm"] == "-0.500000000"
    assert rows[-1]["A_position_counts"] == str(-500 + 600)
    assert rows[-1]["y_mm"] == f"{(40 - 42) / -100:.9f}"
    assert rows[-1]["vy_mm_s"] == f"{-210 / -100:.9f}"
    assert float(rows[-1]["time_s"]) == pytest.approx(12 / 1024)
    assert [row["time_samples"] for row in rows] == ["0", "2", "4", "6"]


def test_segment_table_has_the_axes_side_by_side() -> None:
    lines = list(exchange_lines(_program(), "pvt.csv", ""))
    assert lines[0] == "A Position,A Velocity,A Time,B Position,B Velocity,B Time"
    assert lines[1] == "100,1000,2,-7,-70,2"
    assert len(lines) == 4


def test_a_short_program_begins_when_all_is_queued() -> None:
    lines = list(exchange_lines(_program(), "pvt.dmc", "a plan"))
    assert lines == [
        "REM a plan",
        "REM axis A starts at -500 counts",
        "PVA=0,0,-1",
        "REM axis B starts at 40 counts",
        "PVB=0,0,-1",
        "PVA=100,1000,2",
        "PVB=-7,-70,2",
        "PVA=200,2000,4",
        "PVB=-14,-140,4",
        "PVA=300,3000,6",
        "PVB=-21,-210,6",
        "PVA=0,0,0",
        "PVB=0,0,0",
        "BT AB",
        "EN",
    ]


def test_a_long_program_begins_when_the_buffer_is_full() -> None:
    lines = list(exchange_lines(_program(300), "pvt.dmc", "x" * 500))
    before = lines[: lines.index("BT AB")]
    assert sum(line.startswith("PVA=") and not line.endswith(",-1") for line in before) == 254
    assert sum(line.startswith("PVB=") for line in lines) == 302
    assert max(len(line) for line in lines) <= 80


@pytest.mark.parametrize(("form", "other_lines"), [("csv", 2), ("pvt.csv", 1), ("pvt.dmc", 309)])
def test_all_forms_hold_every_segment(form: str, other_lines: int) -> None:
    assert form in FORMATS
    assert len(list(exchange_lines(_program(300), form, ""))) == 300 + other_lines
