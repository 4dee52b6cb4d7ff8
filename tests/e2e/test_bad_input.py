"""Every bad input ends in one clear line, the exit code of its kind, and no file."""

import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ibfctl.cli.main import run
from tests.support.small_job import PITCH, TIF, SmallJob

BAD_INPUT, LIMITS, CONTROLLER = 2, 3, 5


@pytest.fixture
def refused(small_job: SmallJob, capsys: pytest.CaptureFixture[str]) -> Callable[[list[str], int], str]:
    """Run a command that must fail, and return what it said."""
    before = set(small_job.folder.iterdir())

    def check(arguments: list[str], code: int) -> str:
        existing = before | set(small_job.folder.iterdir())
        assert run(arguments) == code
        captured = capsys.readouterr()
        assert captured.out == ""
        errors = [line for line in captured.err.splitlines() if line.startswith("error: ")]
        assert len(errors) == 1
        assert captured.err.splitlines()[-1] == errors[0]
        assert "Traceback" not in captured.err
        assert set(small_job.folder.iterdir()) == existing
        return errors[0]

    return check


Refused = Callable[[list[str], int], str]


def _plan(job: SmallJob, *more: str, map_file: Path | None = None, tif: str = TIF) -> list[str]:
    output = str(job.folder / "plan.h5")
    arguments = ["plan", str(map_file or job.map), tif, "--machine", str(job.machine), *PITCH, "-o", output]
    return [*arguments, *more]


def test_an_aperture_without_pixels(small_job: SmallJob, refused: Refused) -> None:
    assert "clear aperture" in refused(_plan(small_job, "--clear-aperture", "50,60,50,60"), BAD_INPUT)


def test_an_aperture_inside_out(small_job: SmallJob, refused: Refused) -> None:
    assert "is empty" in refused(_plan(small_job, "--clear-aperture", "5,-5,-3,3"), BAD_INPUT)
    assert "is none of X0,X1,Y0,Y1" in refused(_plan(small_job, "--clear-aperture", "5,-5"), BAD_INPUT)


def test_a_map_without_any_valid_pixel(small_job: SmallJob, refused: Refused) -> None:
    np.savez(small_job.map, height_nm=np.full((9, 9), np.nan), pixel_mm=0.25)
    assert "no valid pixel" in refused(_plan(small_job), BAD_INPUT)


def test_a_tool_larger_than_the_map(small_job: SmallJob, refused: Refused) -> None:
    tif = "gaussian:fwhm_mm=16,peak_nm_s=4,radius_mm=20"
    assert "larger than the map" in refused(_plan(small_job, tif=tif), BAD_INPUT)


@pytest.mark.parametrize("pixel_mm", [0.0, -0.25])
def test_a_pixel_size_that_is_not_positive(small_job: SmallJob, refused: Refused, pixel_mm: float) -> None:
    np.savez(small_job.map, height_nm=np.ones((9, 9)), pixel_mm=pixel_mm)
    assert "must be positive" in refused(_plan(small_job), BAD_INPUT)
    np.savez(small_job.map, height_nm=np.ones((9, 9)))
    assert "must be positive" in refused(_plan(small_job, "--map-pixel-mm", str(pixel_mm)), BAD_INPUT)


def test_a_map_without_units(small_job: SmallJob, refused: Refused) -> None:
    np.savez(small_job.map, height=np.ones((9, 9)), pixel_mm=0.25)
    assert "--map-unit" in refused(_plan(small_job), BAD_INPUT)


def test_mixed_units(small_job: SmallJob, refused: Refused) -> None:
    table = small_job.folder / "map.csv"
    table.write_text("x_mm,y_m,height_nm\n0,0,1\n1,0,2\n0,1,3\n1,1,4\n")
    assert "mixed units" in refused(_plan(small_job, map_file=table), BAD_INPUT)


def test_a_path_that_leaves_the_travel(small_job: SmallJob, refused: Refused) -> None:
    nodes = small_job.folder / "nodes.csv"
    nodes.write_text("x_mm,y_mm\n" + "\n".join(f"{x},0" for x in range(230, 260)) + "\n")
    assert "travel" in refused(_plan(small_job, "--path", str(nodes)), LIMITS)


def test_dwell_times_shorter_than_the_limits_allow(small_job: SmallJob, refused: Refused) -> None:
    nodes = small_job.folder / "timed.csv"
    nodes.write_text("x_mm,y_mm,dwell_s\n0,0,0\n10,0,0.5\n20,0,0.01\n30,0,0.5\n")
    output = str(small_job.folder / "plan.h5")
    said = refused(["schedule", str(nodes), "--machine", "simulator", "-o", output], LIMITS)
    assert "node" in said


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 and then nothing", bytes(1000)])
def test_a_corrupt_map(small_job: SmallJob, refused: Refused, content: bytes) -> None:
    small_job.map.write_bytes(content)
    assert str(small_job.map) in refused(_plan(small_job), BAD_INPUT)


@pytest.mark.parametrize("verb", [["simulate"], ["export", "--format", "csv"]])
def test_a_corrupt_plan(small_plan: Path, small_job: SmallJob, refused: Refused, verb: list[str]) -> None:
    damaged = small_job.folder / "damaged.h5"
    whole = small_plan.read_bytes()
    for content in (b"", b"not HDF5", whole[: len(whole) // 2], bytes(4096) + whole[4096:]):
        damaged.write_bytes(content)
        assert str(damaged) in refused([verb[0], str(damaged), *verb[1:], "-o", str(damaged) + ".out"], BAD_INPUT)
    assert "absent.h5" in refused([verb[0], str(small_job.folder / "absent.h5"), *verb[1:]], BAD_INPUT)


def test_a_machine_file_with_an_unknown_key(small_job: SmallJob, refused: Refused) -> None:
    machine = small_job.folder / "machine.toml"
    machine.write_text(small_job.machine.read_text() + "\n[turbo]\nboost = 2\n")
    said = refused([*_plan(small_job), "--machine", str(machine)], BAD_INPUT)
    assert "turbo" in said


def test_a_machine_that_does_not_exist(small_job: SmallJob, refused: Refused) -> None:
    assert "teapot" in refused([*_plan(small_job), "--machine", "teapot"], BAD_INPUT)


def test_an_output_folder_that_does_not_exist(small_job: SmallJob, refused: Refused) -> None:
    output = str(small_job.folder / "absent" / "plan.h5")
    assert "does not exist" in refused([*_plan(small_job), "-o", output], BAD_INPUT)


def test_unknown_verbs_and_options(refused: Refused) -> None:
    assert "polish" in refused(["polish"], BAD_INPUT)
    assert "--shiny" in refused(["plan", "--shiny"], BAD_INPUT)


def test_two_aims_at_once(small_job: SmallJob, refused: Refused) -> None:
    said = refused(_plan(small_job, "--max-time", "9", "--max-residual", "1"), BAD_INPUT)
    assert "exclude each other" in said
    assert "at least" in refused(_plan(small_job, "--max-time", "0.1"), LIMITS)


def test_a_slowest_speed_that_the_machine_cannot_keep(small_job: SmallJob, refused: Refused) -> None:
    assert "steps cannot be" in refused(_plan(small_job, "--v-min-mm-s", "50"), LIMITS)
    assert "give --v-min-mm-s" in refused(_plan(small_job, "--dwell-bounds", "ramp"), BAD_INPUT)


def test_a_demo_without_the_extra_for_pictures(refused: Refused, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ibfctl.cli.demo.find_spec", lambda name: None)
    assert "ibfctl[plots]" in refused(["demo"], BAD_INPUT)


def test_a_port_in_use(small_job: SmallJob, refused: Refused) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        data = str(small_job.folder / "data")
        said = refused(["serve", "--simulate", "--port", str(port), "--data", data], BAD_INPUT)
    assert f"port {port}" in said


def test_an_abort_that_reaches_nobody(small_job: SmallJob, refused: Refused) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    abort = ["abort", "--data", str(small_job.folder / "data"), "--url"]
    assert f"127.0.0.1:{port}" in refused([*abort, f"http://127.0.0.1:{port}"], CONTROLLER)
    assert "no address" in refused([*abort, "http://127.0.0.1:99999"], CONTROLLER)


@pytest.mark.parametrize("url", ["http://127.0.0.1:x", "http://[::1"])
def test_an_address_that_is_none(refused: Refused, url: str) -> None:
    assert url in refused(["runs", "list", "--url", url], 9)


def test_an_output_does_not_replace_what_is_read(small_job: SmallJob, refused: Refused) -> None:
    before = small_job.map.read_bytes()
    assert "what is read" in refused(["plan", *_plan(small_job)[1:-1], str(small_job.map)], BAD_INPUT)
    assert small_job.map.read_bytes() == before


def test_a_device_is_not_replaced(small_job: SmallJob, refused: Refused) -> None:
    assert "/dev/null" in refused(["plan", *_plan(small_job)[1:-1], "/dev/null"], BAD_INPUT)
    assert Path("/dev/null").is_char_device()


@pytest.mark.parametrize("place", [[], ["--x-mm", "nan"]])
def test_a_move_to_nowhere(refused: Refused, place: list[str]) -> None:
    refused(["machine", "move", *place, "--url", "http://127.0.0.1:1"], BAD_INPUT)


def test_a_key_that_is_none(refused: Refused, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("IBFCTL_KEY", "ibf_ä")
    assert "the key" in refused(["runs", "list", "--url", "http://127.0.0.1:1"], BAD_INPUT)


def test_an_address_that_others_can_reach(refused: Refused) -> None:
    assert "other computers" in refused(["serve", "--simulate", "--host", "0.0.0.0"], BAD_INPUT)


def test_the_real_command_shows_no_traceback_either(small_job: SmallJob) -> None:
    child = subprocess.run(
        [sys.executable, "-m", "ibfctl", *_plan(small_job, map_file=small_job.folder / "absent.npz")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert child.returncode == BAD_INPUT
    assert child.stdout == ""
    assert child.stderr.startswith("error: map ")
    assert child.stderr.count("\n") == 1
