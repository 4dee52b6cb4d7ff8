"""Every fault of the operator's page has a test, and what the page says is told is what the product says.

The tests of each fault are named here, wherever they live; the page says what an operator makes of it.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "faults.md").read_text(encoding="utf-8")
GAP = "…"
SHORTEST = 6
"""Fewer letters between gaps are no message."""

TABLE = "scenarios/test_fault_table.py::test_no_fault_drills_a_hole"
TESTS: dict[str, tuple[str, ...]] = {
    "the host stalls, or its network is slow": (TABLE, "contract/driver/test_contour.py::test_a_host_that_stalls"),
    "the worker is killed": (
        "scenarios/test_guard.py::test_a_host_that_is_gone",
        "contract/driver/test_recovery.py::test_what_a_killed_worker_has_executed",
        "service/test_runs.py::test_a_run_whose_worker_was_killed",
    ),
    "the worker hangs": ("service/test_silence.py::test_a_worker_that_hangs",),
    "the service is killed": (
        "contract/driver/test_recovery.py::test_whenever_a_worker_or_a_service_is_killed",
        "service/test_runs.py::test_a_run_outlives_the_service",
    ),
    "cable pulled, link half-open": (TABLE, "contract/driver/test_recovery.py::test_a_cable_that_is_pulled"),
    "links reset, controller without power": (TABLE, "scenarios/test_faults.py::test_a_reset_handle"),
    "one link of several falls silent": (TABLE, "scenarios/test_faults.py::test_a_controller_that_no_longer_answers"),
    "a reply is late, lost, or one too many": (TABLE, "scenarios/test_faults.py::test_a_stale_reply"),
    "text within a reply, or unasked": (
        "scenarios/test_faults.py::test_unmarked_text_inside_a_reply",
        "scenarios/test_faults.py::test_unmarked_text_that_nobody_asked_for",
    ),
    "a segment is refused": (TABLE, "scenarios/test_faults.py::test_a_refused_segment"),
    "the axes' counts diverge": (TABLE, "scenarios/test_faults.py::test_counts_that_disagree"),
    "the controller says done too early, or stops short": (
        "scenarios/test_faults.py::test_a_controller_that_says_done_before",
        "unit/runs/test_counts.py::test_complete_is_expected_only_once",
    ),
    "stop, abort or e-stop on request": (TABLE, "scenarios/test_nothing_moves_afterwards.py::test_nothing_moves_after"),
    "somebody else stops the axes": (TABLE,),
    "soft or hard limit, following error": (TABLE, "scenarios/test_machine_faults.py::test_a_fault_ends_the_run"),
    "encoder failure": (TABLE,),
    "hardware e-stop, abort input, amplifiers": (TABLE, "contract/driver/test_conductor.py::test_an_emergency_stop_of"),
    "the output is left on after a halt": (
        TABLE,
        "scenarios/test_fault_table.py::test_a_gate_left_open_by_somebody",
    ),
    "the sample time is wrong": (
        "scenarios/test_fault_table.py::test_a_sample_that_lasts_too_long",
        "contract/driver/test_conductor.py::test_a_time_base_that_was_wrong",
    ),
    "the controller loses its power during a pause": (
        "contract/driver/test_conductor.py::test_a_controller_that_loses_its_power_while_paused",
    ),
    "two clients start at once": (
        "scenarios/test_disk_and_starts.py::test_of_two_runs_started_at_once",
        "contract/driver/test_conductor.py::test_somebody_elses_run_is_left_alone",
    ),
    "the clock on the wall jumps": ("scenarios/test_fault_table.py::test_a_clock_on_the_wall",),
    "a defect of this software": ("contract/driver/test_conductor.py::test_what_was_executed_is_known_though",),
    "disk full, database locked": (
        "scenarios/test_disk_and_starts.py::test_a_disk_that_is_full",
        "contract/driver/test_worker_process.py::test_a_journal_that_is_locked",
    ),
    "an interlock is out of its band": ("contract/driver/test_conductor.py::test_an_interlock_pauses_the_run",),
}


def rows(heading: str) -> list[list[str]]:
    section = PAGE.split(f"## {heading}\n")[1].split("\n## ")[0]
    lines = [line for line in section.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


def texts(tree: ast.AST) -> Iterator[str]:
    """All strings of a module, with a gap wherever something is filled in."""
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            yield "".join(part.value if isinstance(part, ast.Constant) else GAP for part in node.values)  # type: ignore[misc]
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value


@pytest.fixture(scope="module")
def said() -> str:
    modules = [path for folder in ("src/ibfctl", "drivers") for path in (ROOT / folder).rglob("*.py")]
    return "\n".join(text for path in modules for text in texts(ast.parse(path.read_text(encoding="utf-8"))))


def test_what_the_page_says_is_told_is_in_the_code(said: str) -> None:
    told = [cells[1] for cells in rows("A run that is under way")] + [
        cells[0] for cells in rows("A run that does not begin")
    ]
    messages = [message for cell in told for message in re.findall(r"`([^`]+)`", cell)]
    parts = [part.strip() for message in messages for part in re.split(f"{GAP}|: ", message)]
    worth = [part for part in parts if len(part) >= SHORTEST and not part.startswith(("journal_ok", "Connection"))]
    assert len(worth) > len(rows("A run that is under way"))
    assert [part for part in worth if part not in said] == []


def test_every_fault_of_the_page_has_a_test() -> None:
    assert [cells[0] for cells in rows("A run that is under way")] == list(TESTS)
    for fault, tests in TESTS.items():
        for test in tests:
            module, name = test.split("::")
            text = (ROOT / "tests" / module).read_text(encoding="utf-8")
            assert re.search(rf"^def {name}\w*\(", text, re.MULTILINE), f"{fault}: {test}"
