import pytest

from ibfctl.cli.main import run
from ibfctl.cli.remote import failed
from ibfctl.errors import RunError


@pytest.mark.parametrize(("code", "exit_code"), [("interrupted", 6), ("faulted", 6), ("aborted", 7), ("link", 5)])
def test_a_run_that_ended_otherwise_has_an_exit_code_of_its_own(code: str, exit_code: int) -> None:
    assert failed({"code": code, "detail": "run", "hint": ""}, RunError).exit_code == exit_code


def test_a_number_that_is_none(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["plan", "map.npz", "tif.npz", "--machine", "simulator", "--seconds-per-nm", "nan"]) == 2
    assert "nan is no number" in capsys.readouterr().err
