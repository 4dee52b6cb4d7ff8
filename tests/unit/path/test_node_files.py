"""Node files: what is read, and the line that is named when it cannot be."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from ibfctl.errors import InputError
from ibfctl.path.from_file import read_columns, read_nodes
from ibfctl.path.tool_path import ToolPath


@pytest.fixture
def write(tmp_path: Path):
    def write(content: str | bytes) -> Path:
        path = tmp_path / "nodes.csv"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


def test_nodes_in_order_whatever_else_the_file_holds(write) -> None:
    path = read_nodes(write("y_mm, note ,x_mm\n0.5,first,-1\n\n1e1,last,2.25\n"))
    assert path.x_mm.tolist() == [-1.0, 2.25]
    assert path.y_mm.tolist() == [0.5, 10.0]
    assert path.segments == 1


def test_lines_may_end_as_they_do_elsewhere(write) -> None:
    assert read_nodes(write("x_mm,y_mm\r\n0,0\r\n1,2\r\n")).y_mm.tolist() == [0.0, 2.0]


def test_a_byte_order_mark_is_no_part_of_the_first_name(write) -> None:
    assert read_nodes(write(b"\xef\xbb\xbfx_mm,y_mm\n0,0\n1,2\n")).x_mm.tolist() == [0.0, 1.0]


def test_three_columns_for_the_scheduler(write) -> None:
    columns = read_columns(write("x_mm,y_mm,dwell_s\n0,0,0\n1,2,0.5\n"), ("x_mm", "y_mm", "dwell_s"))
    assert [column.tolist() for column in columns] == [[0.0, 1.0], [0.0, 2.0], [0.0, 0.5]]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("x,y\n0,0\n1,1\n", "column x_mm, y_mm missing"),
        ("x_mm,y_m\n0,0\n", "column y_mm missing"),
        ("0,0\n1,1\n", "column x_mm, y_mm missing"),
        ("", "column x_mm, y_mm missing"),
        ("x_mm,y_mm\n", "holds 0 rows"),
        ("x_mm,y_mm\n1,1\n", "at least two nodes"),
        ("x_mm,y_mm\n0,0\n1,two\n", "line 3"),
        ("x_mm,y_mm\n0,0\n\n\n1,nan\n", "line 5"),
        ("x_mm,y_mm\n0,0\n1,inf\n", "line 3"),
        ("x_mm,y_mm\n0,0\n1\n", "line 3"),
        ("x_mm,y_mm\n0,0\n1,\n", "line 3"),
        ("x_mm;y_mm\n0;0\n1;1\n", "column x_mm, y_mm missing"),
        (b"x_mm,y_mm\n0,\xff\n", "cannot be read"),
    ],
)
def test_a_bad_file_ends_in_one_line_with_file_and_place(write, content: str | bytes, said: str) -> None:
    path = write(content)
    with pytest.raises(InputError, match=re.escape(said)) as caught:
        read_nodes(path)
    assert "\n" not in str(caught.value)
    assert str(path) in caught.value.message


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=re.escape(str(tmp_path / "absent.csv"))):
        read_nodes(tmp_path / "absent.csv")
    with pytest.raises(InputError, match="cannot be read"):
        read_nodes(tmp_path)


@pytest.mark.parametrize(
    ("x_mm", "y_mm", "said"),
    [
        ([0.0], [0.0], "at least two nodes"),
        ([0.0, 1.0], [0.0], "at least two nodes"),
        ([0.0, 1.0, np.nan], [0.0, 1.0, 2.0], "node 2"),
        ([0.0, 1.0, 2.0], [0.0, np.inf, 2.0], "node 1"),
    ],
)
def test_a_path_is_two_finite_nodes_at_least(x_mm: list[float], y_mm: list[float], said: str) -> None:
    with pytest.raises(InputError, match=said):
        ToolPath(np.array(x_mm), np.array(y_mm))


def test_dwell_points_lie_in_the_middle_of_the_segments() -> None:
    path = ToolPath(np.array([0.0, 3.0, 3.0]), np.array([0.0, 4.0, 5.0]))
    assert path.dwell_x_mm.tolist() == [1.5, 3.0]
    assert path.dwell_y_mm.tolist() == [2.0, 4.5]
    assert path.length_mm.tolist() == [5.0, 1.0]
    assert path.segments == 2


def test_straight_is_where_a_path_goes_on_without_a_turn() -> None:
    nodes = [(0, 0), (1, 1), (3, 3), (3, 5), (3, 4), (3, 4), (3, 3)]
    path = ToolPath(*(np.array(values, dtype=float) for values in zip(*nodes, strict=True)))
    # on, turn, back, into a repeated node, out of it
    assert path.straight.tolist() == [True, False, False, False, False]
