from pathlib import Path

import numpy as np
import pytest

from ibfctl.errors import InputError
from ibfctl.jobs.timed_nodes import read_timed_nodes

GOOD = "x_mm,y_mm,dwell_s\n0,0,0\n1,0,0.5\n1,1,0.25\n"


def test_nodes_are_read_in_order(tmp_path: Path) -> None:
    (tmp_path / "n.csv").write_text(GOOD)
    nodes = read_timed_nodes(tmp_path / "n.csv")
    np.testing.assert_array_equal(nodes.x_mm, [0, 1, 1])
    np.testing.assert_array_equal(nodes.y_mm, [0, 0, 1])
    np.testing.assert_array_equal(nodes.dwell_s, [0, 0.5, 0.25])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "first line is ''"),
        (GOOD.replace("dwell_s", "time"), "begin with x_mm,y_mm,dwell_s"),
        ("x_mm,y_mm,dwell_s\n0,0,0\n", "holds 1 nodes"),
        (GOOD.replace("0,0,0", "0,0,1"), "dwell_s of the first node is 1"),
        (GOOD.replace("1,1,0.25", "1,1,0"), "dwell_s in line 4 is not positive"),
        (GOOD.replace("1,0,0.5", "1,0"), "line 3 holds no three numbers"),
        (GOOD.replace("1,0,0.5", "1,0,x"), "line 3 holds no three numbers"),
        (GOOD.replace("1,0,0.5", "1,nan,1"), "line 3 holds a value that is not finite"),
    ],
)
def test_a_wrong_table_is_refused_with_its_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "n.csv"
    path.write_text(text)
    with pytest.raises(InputError) as refusal:
        read_timed_nodes(path)
    assert message in str(refusal.value)
    assert str(path) in str(refusal.value)


def test_an_absent_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        read_timed_nodes(tmp_path / "absent.csv")
