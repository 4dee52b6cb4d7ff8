import sys

import pytest

from ibfctl.cli import watch

TOLD = {
    "state": "running",
    "progress": 0.25,
    "eta_s": 3725.0,
    "margin_s": 1.5,
    "gate": "open",
    "executed": 5,
    "total": 20,
    "residual_rms_nm": None,
}


def test_a_status_is_said_in_one_line() -> None:
    assert watch.describe(TOLD) == "running  25.0%  1:02:05 to the end  margin 1.50 s  gate open  segment 5 of 20"
    faulted = {"state": "faulted", "reason": "the cable is out", "hint": None}
    assert watch.describe(faulted) == "faulted  the cable is out"


def test_without_a_terminal_there_is_a_line_at_every_change_of_state(capsys: pytest.CaptureFixture[str]) -> None:
    with watch.display() as show:
        for state in ("queued", "running", "running", "completed"):
            show({"state": state})
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.split() == ["queued", "running", "completed"]


def test_on_a_terminal_there_is_a_bar_and_the_gate(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    with watch.display() as show:
        show(TOLD)
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "beam gate open" in captured.err
