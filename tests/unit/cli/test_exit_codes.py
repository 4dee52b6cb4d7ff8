import pytest

from ibfctl.cli.main import run
from ibfctl.cli.remote import failed
from ibfctl.errors import RunError


@pytest.mark.parametrize(("code", "exit_code"), [("interrupted", 6), ("faulted", 6), ("aborted", 7), ("link", 5)])
def test_a_run_that_ended_otherwise_has_an_exit_code_of_its_own(code: str, exit_code: int) -> None:
    assert failed({"code": code, "detail": "run", "hint": ""}, RunError).exit_code == exit_code


@pytest.mark.parametrize("option", ["--seconds-per-nm", "--max-time", "--margin"])
@pytest.mark.parametrize("number", ["nan", "inf"])
def test_a_number_that_is_none(option: str, number: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["plan", "map.npz", "tif.npz", "--machine", "simulator", option, number]) == 2
    assert f"{number} is not a finite number" in capsys.readouterr().err
