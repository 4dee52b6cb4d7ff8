"""`ibfctl plan --tool` as other programs and people see it."""

import io
import json
from pathlib import Path

import h5py
import pytest

from ibfctl.cli.main import run
from ibfctl.planning.file import read_plans, read_sequence
from tests.support.small_job import SmallJob

NARROW = "gaussian:fwhm_mm=1.6,peak_nm_s=4,radius_mm=2"
WIDE = "gaussian:fwhm_mm=3,peak_nm_s=6,radius_mm=3.5"


def _plan(job: SmallJob, *more: str) -> list[str]:
    return ["plan", str(job.map), "--machine", str(job.machine), "-o", str(job.folder / "plan.h5"), *more]


def _refusal(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    capsys.readouterr()
    assert run(arguments) == 2
    return capsys.readouterr().err


@pytest.mark.parametrize("method", ["ours", "mto", "sto"])
def test_a_plan_of_two_tools(small_job: SmallJob, method: str, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = _plan(small_job, "--tool", f"{NARROW}:pitch-mm=1,step-mm=1", "--tool", WIDE, "--method", method)
    assert run([*arguments, "--tool-change-s", "60", "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["method"] == method
    assert [tool["influence"] for tool in figures["tools"]] == [WIDE, NARROW]
    assert [round(tool["pitch_mm"], 3) for tool in figures["tools"]] == [1.222, 1.0]
    assert figures["total_time_s"] == pytest.approx(60 + sum(tool["total_time_s"] for tool in figures["tools"]))
    assert figures["executed_rms_nm"] < 0.3 * figures["initial_rms_nm"]
    assert figures["certificate"]["passed"]
    with h5py.File(small_job.folder / "plan.h5") as file:
        assert set(file["tools"]) == {"1", "2"}
        assert "program" in file["tools/1"]


def test_people_get_a_row_for_each_tool(small_job: SmallJob, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(_plan(small_job, "--tool", NARROW, "--tool", WIDE, "--no-loop", "--seconds-per-nm", "100")) == 0
    rows = capsys.readouterr().out.splitlines()
    assert [row.split()[-1] for row in rows if row[:1].isdigit()] == [WIDE, NARROW]


def test_one_tool_alone_makes_an_ordinary_plan(small_job: SmallJob, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(_plan(small_job, "--tool", f"{NARROW}:path=maze", "--pitch-mm", "1", "--no-loop", "--json")) == 0
    (tool,) = json.loads(capsys.readouterr().out)["tools"]
    (plan,) = read_plans(small_job.folder / "plan.h5")
    assert tool["pitch_mm"] == plan.options.pitch_mm == 1.0
    assert plan.options.path == "maze"
    with h5py.File(small_job.folder / "plan.h5") as file:
        assert "program" in file


def test_each_tool_may_have_its_own_machine(small_job: SmallJob, capsys: pytest.CaptureFixture[str]) -> None:
    slow = small_job.folder / "slow.toml"
    slow.write_text(Path(small_job.machine).read_text().replace("v_max_mm_s = 250.0", "v_max_mm_s = 20.0"))
    tools = ("--tool", f"{WIDE}:machine={slow}", "--tool", f"{NARROW}:machine=simulator")
    output = small_job.folder / "plan.h5"
    assert run(["plan", str(small_job.map), *tools, "-o", str(output), "--json"]) == 0
    peaks = [tool["peak_velocity_mm_s"]["A"] for tool in json.loads(capsys.readouterr().out)["tools"]]
    assert peaks[0] <= 20.0 < peaks[1]
    assert [plan.machine.axes["A"].v_max_mm_s for plan in read_plans(output)] == [20.0, 250.0]


def test_what_does_not_go_together_is_refused(small_job: SmallJob, capsys: pytest.CaptureFixture[str]) -> None:
    tool = ("--tool", NARROW)
    assert "either TIF or --tool" in _refusal(_plan(small_job), capsys)
    assert "either TIF or --tool" in _refusal(_plan(small_job, NARROW, *tool), capsys)
    assert "--trade-off" in _refusal(_plan(small_job, *tool, "--trade-off"), capsys)
    assert "l-curve" in _refusal(_plan(small_job, *tool, "--tikhonov", "l-curve"), capsys)
    assert "exclude each other" in _refusal(
        _plan(small_job, *tool, "--seconds-per-nm", "10", "--margin", "0.1"), capsys
    )
    assert "no machine" in _refusal(["plan", str(small_job.map), *tool], capsys)
    assert "--machine" in _refusal(["plan", str(small_job.map), NARROW], capsys)
    assert "neither x nor y" in _refusal(_plan(small_job, "--tool", f"{NARROW}:scan-axis=z"), capsys)
    assert "no positive length" in _refusal(_plan(small_job, "--tool", f"{NARROW}:pitch-mm=-1"), capsys)
    assert not (small_job.folder / "plan.h5").exists()


def test_the_programs_run_in_sequence_when_changes_are_confirmed(
    small_job: SmallJob, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run(_plan(small_job, "--tool", f"{NARROW}:pitch-mm=1,step-mm=1", "--tool", WIDE, "--json")) == 0
    planned = json.loads(capsys.readouterr().out)
    output = small_job.folder / "run.h5"
    simulate = ["simulate", str(small_job.folder / "plan.h5"), "--speed", "400", "-o", str(output)]
    assert run([*simulate, "--yes", "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["as_run_rms_nm"] == pytest.approx(planned["executed_rms_nm"], rel=0.05)
    assert figures["segments_executed"] == planned["segments"]
    assert [tool["run"] for tool in figures["tools"]] == ["run.tool1.h5", "run.tool2.h5"]
    assert all((small_job.folder / tool["run"]).is_file() for tool in figures["tools"])
    with h5py.File(output) as file:
        assert file.attrs["format"] == "ibfctl-tools-run/1"
        assert file["as_run"].attrs["rms_nm"] == figures["as_run_rms_nm"]
    output.unlink()
    monkeypatch.setattr("sys.stdin", io.StringIO("n\n"))
    assert run(simulate) == 7
    assert "stopped before tool 2" in capsys.readouterr().err
    assert not output.exists()


def test_subsets_of_tools_are_compared(small_job: SmallJob, capsys: pytest.CaptureFixture[str]) -> None:
    suggest = ["tools", "suggest", str(small_job.map), f"{NARROW}:pitch-mm=1", WIDE]
    assert run([*suggest, "--machine", str(small_job.machine), "--seconds-per-nm", "100", "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert {tuple(subset["tools"]) for subset in figures["subsets"]} == {(1,), (2,), (2, 1)}
    assert sum(subset["chosen"] for subset in figures["subsets"]) == 1
    assert figures["initial"][0]["longest_mm"] is None
    assert run(suggest) == 0
    rows = capsys.readouterr().out.splitlines()
    assert rows[0].endswith(f"{NARROW}")
    assert sum(row.endswith("chosen") for row in rows) == 1
    assert "exclude" in _refusal([*suggest, "--margin", "0.1", "--seconds-per-nm", "100"], capsys)
    assert "Missing argument" in _refusal(["tools", "suggest", str(small_job.map)], capsys)


def test_a_plan_is_taken_apart_and_its_later_tools_planned_anew(
    small_job: SmallJob, capsys: pytest.CaptureFixture[str]
) -> None:
    tools = ("--tool", f"{NARROW}:pitch-mm=1", "--tool", f"{WIDE}:pitch-mm=2")
    assert run(_plan(small_job, *tools, "--no-loop")) == 0
    whole, first = small_job.folder / "plan.h5", small_job.folder / "plan.tool1.h5"
    assert "holds the plans of 2 tools" in _refusal(["export", str(whole), "--format", "csv"], capsys)
    assert run(["tools", "split", str(whole)]) == 0
    split = [read_plans(path)[0] for path in (first, small_job.folder / "plan.tool2.h5")]
    assert [plan.inputs["influence"].name for plan in split] == [WIDE, NARROW]
    done, later = small_job.folder / "first.h5", small_job.folder / "later.h5"
    assert run(["simulate", str(first), "--speed", "400", "-o", str(done)]) == 0
    capsys.readouterr()
    assert run(["tools", "replan", str(whole), str(done), "-o", str(later), "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert [tool["influence"] for tool in figures["tools"]] == [NARROW]
    (plan,) = read_plans(later)
    assert plan.inputs["influence"].name == NARROW
    # Planned for what was really removed, it leaves no more than the plan promised.
    assert figures["executed_rms_nm"] <= 1.02 * _executed_nm(whole)
    assert "replan between" in _refusal(
        ["tools", "replan", str(whole), str(done), "--done", "2", "-o", str(later)], capsys
    )


def _executed_nm(path: Path) -> float:
    figures = read_sequence(path).summary()
    return float(figures["executed_rms_nm"])  # type: ignore[arg-type]
