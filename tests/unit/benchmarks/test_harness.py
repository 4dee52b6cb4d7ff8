import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from benchmarks import Absent, _harness, _report


def _result(monkeypatch: pytest.MonkeyPatch, run: object) -> dict[str, object]:
    monkeypatch.setattr(_harness.importlib, "import_module", lambda name: SimpleNamespace(run=run))
    return _harness.run("anything")


@pytest.mark.parametrize(
    ("value", "target", "passed"),
    [
        (1.0, {"max": 1.0}, True),
        (1.1, {"max": 1.0}, False),
        (1.0, {"min": 1.0}, True),
        (0.9, {"min": 1.0}, False),
        (float("nan"), {"max": 1.0}, False),
        (5.0, {"min": 1.0, "max": 4.0}, False),
    ],
)
def test_metrics_are_judged_by_their_targets(
    monkeypatch: pytest.MonkeyPatch, value: float, target: dict[str, float], passed: bool
) -> None:
    result = _result(monkeypatch, lambda: {"metrics": {"a_s": value, "free": 3}, "targets": {"a_s": target}})
    assert result["passed"] is passed
    assert set(result) == {"name", "metrics", "targets", "passed", "machine"}
    json.dumps(result)


def test_a_target_without_metric_is_a_mistake(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(KeyError, match="b_s"):
        _result(monkeypatch, lambda: {"metrics": {"a_s": 1.0}, "targets": {"b_s": {"max": 1.0}}})


def test_what_is_absent_neither_passes_nor_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    def run() -> dict[str, object]:
        raise Absent("no such data here")

    result = _result(monkeypatch, run)
    assert result["passed"] is None
    assert result["absent"] == "no such data here"


def test_every_benchmark_says_what_it_measures() -> None:
    for name in _harness.names():
        assert _harness.summary(name), name


def test_the_list_names_every_benchmark() -> None:
    listing = subprocess.run(
        [sys.executable, "-m", "benchmarks", "list"],
        cwd=_harness.FOLDER.parent,
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    assert [line.split()[0] for line in listing.splitlines()] == _harness.names()


def test_the_report_replaces_what_stands_between_the_markers(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(_report, "OUT", tmp_path / "out")
    monkeypatch.setattr(_report, "RESULTS", tmp_path / "results.md")
    _report.RESULTS.write_text(f"before\n{_report.BEGIN}\nold\n{_report.END}\nafter\n", encoding="utf-8")
    machine = _harness.machine()
    _report.store(
        {"name": "a", "metrics": {"t_s": 0.12345, "n": 7}, "targets": {"t_s": {"max": 0.1}}, "passed": False}
        | {"machine": machine, "tables": [{"columns": ["path", "nm"], "rows": [["maze", "0.3"]]}]}
    )
    _report.store(
        {"name": "b", "metrics": {}, "targets": {}, "passed": None, "machine": machine, "absent": "no data"}
    )
    _report.write_report()
    text = _report.RESULTS.read_text(encoding="utf-8")
    assert text.startswith("before\n")
    assert text.endswith("after\n")
    assert "old" not in text
    assert "| `a` | `t_s` | 0.1235 | ≤ 0.1 | **missed** |" in text
    assert "| `a` | `n` | 7 |  |  |" in text
    assert "`a`:\n\n| path | nm |\n| --- | --- |\n| maze | 0.3 |\n" in text
    assert "| `b` | | | | absent: no data |" in text
