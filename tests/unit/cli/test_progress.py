import sys

import pytest

from ibfctl.cli.progress import progress


def test_without_a_terminal_there_is_a_line_at_every_quarter(capsys: pytest.CaptureFixture[str]) -> None:
    with progress() as report:
        for step in range(101):
            report("dwell times", step / 100)
        report("scheduling", 0.0)
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.splitlines() == [
        *(f"dwell times: {percent}%" for percent in (0, 25, 50, 75, 100)),
        "scheduling: 0%",
    ]


def test_on_a_terminal_there_is_a_bar_on_standard_error(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    with progress() as report:
        report("dwell times", 0.5)
        report("dwell times", 1.0)
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "dwell times" in captured.err
