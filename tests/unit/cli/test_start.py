import json
import os
import subprocess
import sys

from click.testing import CliRunner

from ibfctl import __version__
from ibfctl.cli.main import cli

_HEAVY = ("numpy", "scipy", "h5py", "osqp", "fastapi", "pydantic", "matplotlib", "rich", "httpx")


def _loaded_by(statement: str) -> list[str]:
    code = f"import json, sys; {statement}; print(json.dumps([m for m in {_HEAVY!r} if m in sys.modules]))"
    child = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded: list[str] = json.loads(child.stdout.splitlines()[-1])
    return loaded


def test_the_command_line_loads_nothing_numerical() -> None:
    assert _loaded_by("import ibfctl.cli.main") == []


def test_help_of_every_verb_loads_nothing_numerical() -> None:
    verbs = list(cli.list_commands(None))
    runs = "; ".join(f"run([{verb!r}, '--help'])" for verb in verbs)
    assert _loaded_by(f"from ibfctl.cli.main import run; run(['--help']); {runs}") == []


def test_the_version_is_told() -> None:
    assert CliRunner().invoke(cli, ["--version"]).output == f"ibfctl, version {__version__}\n"


def test_python_m_is_the_same_command() -> None:
    child = subprocess.run([sys.executable, "-m", "ibfctl", "--version"], capture_output=True, text=True, check=True)
    assert __version__ in child.stdout


def test_the_shell_completes_nouns() -> None:
    environment = {**os.environ, "_IBFCTL_COMPLETE": "bash_complete", "COMP_WORDS": "ibfctl runs re", "COMP_CWORD": "2"}
    child = subprocess.run(
        [sys.executable, "-m", "ibfctl"], capture_output=True, text=True, check=False, env=environment
    )
    assert sorted(child.stdout.split()) == ["plain,recover", "plain,report", "plain,resume"]
