"""What computes gives way to what moves, and what moves waits for no long collection of garbage."""

import os
import subprocess
import sys

_SHOWN = """
import gc, os, pathlib
from ibfctl.runs.promptness import {name}
{name}()
share = pathlib.Path("/proc/self/autogroup")
shares = share.exists() and share.read_text().strip()
print(os.sched_getscheduler(0), shares.endswith("nice 19") if shares else True, len(gc.get_objects()) < 1000)
"""


def _said(name: str) -> list[str]:
    command = [sys.executable, "-c", _SHOWN.format(name=name)]
    child = subprocess.run(command, capture_output=True, text=True, check=True, start_new_session=True)
    return child.stdout.split()


def test_a_planner_takes_only_time_that_nobody_wants() -> None:
    assert _said("let_others_go_first")[:2] == [str(os.SCHED_IDLE), "True"]


def test_what_was_loaded_is_never_searched_for_garbage_again() -> None:
    assert _said("ready_to_answer_soon")[2] == "True"
