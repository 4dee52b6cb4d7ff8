"""The question at a change of tools: yes goes on; no and the end of the input stop; the keyboard interrupts."""

from __future__ import annotations

import io
import sys

import click
import pytest

from ibfctl.cli.progress import progress
from ibfctl.cli.simulate import accept_change, ask_for_change
from ibfctl.errors import AbortedError
from tests.support.plans import plan_of
from tests.support.programs import program

PLAN = plan_of(program(4))


def test_yes_goes_on(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("y\n"))
    ask_for_change(2, PLAN)
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "Tool 2 (the next tool) mounted on bench" in captured.err
    accept_change(2, PLAN)


@pytest.mark.parametrize("answer", ["n\n", "\n", ""])
def test_anything_else_stops(answer: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO(answer))
    with pytest.raises(AbortedError, match="before tool 3"):
        ask_for_change(3, PLAN)


def test_the_keyboard_interrupts(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*arguments: object) -> str:
        raise KeyboardInterrupt

    monkeypatch.setattr("sys.stdin.readline", interrupt, raising=False)
    monkeypatch.setattr("builtins.input", interrupt)
    with pytest.raises(click.Abort):
        ask_for_change(2, PLAN)


def test_no_bar_is_drawn_over_the_question(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    with progress(plain=True) as report:
        report("streaming", 0.0)
    assert capsys.readouterr().err == "streaming: 0%\n"
