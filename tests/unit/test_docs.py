"""The documentation does what it says: its commands run, its tables name every key and option.

Lines that begin with ``$`` in a ```console block are commands; all of one page run in one shell, in a folder with a
small job. ```python blocks run as they stand. Where a page speaks of http://127.0.0.1:8000, a service answers.
```sh blocks are for the reader alone: .ci/run does what they say.
"""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import click
import numpy as np
import pytest
from pydantic import BaseModel

from ibfctl.cli.main import cli
from ibfctl.machine.description import MachineDescription, parse_machine
from ibfctl.machine.shipped import shipped_machine
from ibfctl.service.settings import Settings
from ibfctl.surface.influence import gaussian
from tests.support.served import serving
from tests.support.small_job import small_height_nm

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
SERVICE = "http://127.0.0.1:8000"


def _blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def _commands(page: Path) -> list[str]:
    return [line[2:] for block in _blocks(page, "console") for line in block.splitlines() if line.startswith("$ ")]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    height_nm = small_height_nm()
    np.savez(tmp_path / "map.npz", height_nm=height_nm, pixel_mm=0.25)
    tif = gaussian(1.6, 4.0, 2.0, 0.25)
    np.savez(tmp_path / "tif.npz", rate_nm_s=tif.rate_nm_s, pixel_mm=tif.pixel_mm)
    dent_nm = 100 * np.exp(-np.add.outer(np.linspace(-3, 3, 61) ** 2, np.linspace(-3, 3, 61) ** 2))
    np.savez(tmp_path / "before.npz", height_nm=np.zeros_like(dent_nm), pixel_mm=0.1)
    np.savez(tmp_path / "after.npz", height_nm=-dent_nm, pixel_mm=0.1)
    points = [f"{x},{y},{value}" for (y, x), value in np.ndenumerate(height_nm)]
    (tmp_path / "heights.csv").write_text("\n".join(["x,y,z", *points]))
    (tmp_path / "timed.csv").write_text("x_mm,y_mm,dwell_s\n0,0,0\n1,0,0.2\n2,0,0.25\n3,0,0.2\n")
    (tmp_path / "machine.toml").write_text(shipped_machine("simulator").read_text(encoding="utf-8"))
    return tmp_path


@pytest.fixture
def address(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    page: Path = request.getfixturevalue("page")
    if SERVICE not in "".join([*_commands(page), *_blocks(page, "python")]):
        yield SERVICE
        return
    with serving(Settings(tmp_path / "data", shipped_machine("simulator"), True, 100.0)) as client:
        yield str(client.base_url).rstrip("/")


def _run(command: list[str], folder: Path) -> None:
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        command, cwd=folder, env={**os.environ, "PATH": path}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("page", [page for page in PAGES if _commands(page)], ids=lambda page: page.name)
def test_the_commands_of_a_page_run(page: Path, folder: Path, address: str) -> None:
    script = "\n".join(["set -euo pipefail", *_commands(page)]).replace(SERVICE, address)
    _run(["bash", "-c", script], folder)


@pytest.mark.parametrize("page", [page for page in PAGES if _blocks(page, "python")], ids=lambda page: page.name)
def test_the_programs_of_a_page_run(page: Path, folder: Path, address: str) -> None:
    if page.name == "file-formats.md":
        _run(["bash", "-c", "ibfctl plan map.npz tif.npz --machine machine.toml --pitch-mm 1 --step-mm 1"], folder)
    for block in _blocks(page, "python"):
        _run([sys.executable, "-W", "error", "-c", block.replace(SERVICE, address)], folder)


def _commands_below(command: click.Command, name: str) -> Iterator[tuple[str, click.Command]]:
    yield name, command
    if isinstance(command, click.Group):
        for verb, below in command.commands.items():
            yield from _commands_below(below, f"{name} {verb}")


def test_every_option_is_in_the_page_of_the_command_line() -> None:
    page = (ROOT / "docs" / "command-line.md").read_text(encoding="utf-8")
    for verb in cli.list_commands(None):
        assert f"## {verb}\n" in page
        section = page.split(f"## {verb}\n")[1].split("\n## ")[0]
        for name, command in _commands_below(cli.get_command(None, verb), verb):
            words = name.split()[1:]
            assert all(word in section for word in words), name
            for parameter in command.params:
                for option in (*parameter.opts, *parameter.secondary_opts):
                    assert not option.startswith("--") or f"`{option}" in page, f"{name} {option}"


def _keys(model: type[BaseModel]) -> Iterator[str]:
    for name, field in model.model_fields.items():
        yield name
        for part in (field.annotation, *getattr(field.annotation, "__args__", ())):
            if isinstance(part, type) and issubclass(part, BaseModel):
                yield from _keys(part)


def test_every_key_is_in_the_page_of_the_machine_file() -> None:
    page = (ROOT / "docs" / "machine-file.md").read_text(encoding="utf-8")
    (example,) = _blocks(ROOT / "docs" / "machine-file.md", "toml")
    parse_machine(example, "docs/machine-file.md")
    keys = set(_keys(MachineDescription))
    assert {"v_max_mm_s", "open_when", "port"} <= keys
    table = page.split("| key |")[1]
    missing = [key for key in keys if not re.search(rf"\b{key}\b", table)]
    assert missing == []


def test_links_between_pages_lead_somewhere() -> None:
    for page in PAGES:
        for link in re.findall(r"\]\((?!http)([^)#]+)", page.read_text(encoding="utf-8")):
            assert (page.parent / link).exists(), f"{page.name}: {link}"
