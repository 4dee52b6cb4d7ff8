"""What computes gives way to what moves, and what moves waits for no long collection of garbage."""

import subprocess
import sys

from ibfctl.runs.promptness import NICENESS

_SHOWN = """
import gc, os, pathlib
from ibfctl.runs.promptness import {name}
{name}()
share = pathlib.Path("/proc/self/autogroup")
shares = share.exists() and share.read_text().strip()
print(os.nice(0), shares.endswith("nice 10") if shares else True, len(gc.get_objects()) < 1000)
"""


def _said(name: str) -> list[str]:
    command = [sys.executable, "-c", _SHOWN.format(name=name)]
    child = subprocess.run(command, capture_output=True, text=True, check=True, start_new_session=True)
    return child.stdout.split()


def test_a_planner_is_nice_among_sessions_as_well() -> None:
    niceness, shared, _ = _said("let_others_go_first")
    assert int(niceness) >= NICENESS
    assert shared == "True"


def test_what_was_loaded_is_never_searched_for_garbage_again() -> None:
    assert _said("ready_to_answer_soon")[2] == "True"
