"""A rehearsal on a host that cannot keep up with the emulated clock."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from support.plans import plan_of
from support.programs import program

from ibfctl.errors import RunError
from ibfctl.jobs import rehearsal
from ibfctl.planning.plan import InputFile
from ibfctl.runs.outcome import RunOutcome
from ibfctl.runs.streamer import execute

PLAN = plan_of(program(40, 64))


def too_busy_above(limit: float, tried: list[float]) -> Callable[..., RunOutcome]:
    """Streaming that starves where the clock runs faster than `limit`."""

    def streamed(*job: Any, time_scale: float, **options: Any) -> RunOutcome:
        tried.append(time_scale)
        if time_scale > limit:
            raise RunError("the buffer was about to run empty")
        return execute(*job, time_scale=time_scale, **options)

    return streamed


def test_it_is_repeated_more_slowly(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    tried: list[float] = []
    monkeypatch.setattr(rehearsal, "execute", too_busy_above(20, tried))
    done = rehearsal.rehearse(PLAN, tmp_path / "run.h5", plan_file=InputFile("plan.h5", "00" * 32), speed=40.0)
    assert tried == [40.0, 10.0]
    assert done.outcome.segments_executed == 40
    assert (tmp_path / "run.h5").is_file()


def test_what_fails_in_real_time_too_has_failed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    tried: list[float] = []
    monkeypatch.setattr(rehearsal, "execute", too_busy_above(0, tried))
    with pytest.raises(RunError, match="about to run empty"):
        rehearsal.rehearse(PLAN, tmp_path / "run.h5", plan_file=InputFile("plan.h5", "00" * 32), speed=8.0)
    assert tried == [8.0, 2.0, 1.0]
    assert list(tmp_path.iterdir()) == []
