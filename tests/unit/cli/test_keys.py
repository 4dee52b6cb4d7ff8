import json
import stat
from pathlib import Path

import pytest
from click.testing import CliRunner

from ibfctl.cli.main import cli
from ibfctl.errors import InputError
from ibfctl.runs.journal import Journal
from ibfctl.runs.places import journal_path
from ibfctl.service.keys import KeyRing, Role


def test_a_token_finds_its_key_and_nothing_else_does(tmp_path: Path) -> None:
    ring = KeyRing(tmp_path)
    key, token = ring.add("panel", Role.OPERATE)
    other, _ = ring.add("other", Role.ADMIN)
    assert ring.find(token) == key
    assert (key.may, other.may) == (Role.OPERATE, Role.ADMIN)
    swapped = token.replace(key.id, other.id)
    for wrong in ("", "ibf", token[:-1], f"{token}x", swapped, token.upper()):
        assert ring.find(wrong) is None


def test_secrets_are_not_kept_and_the_file_is_the_owners_alone(tmp_path: Path) -> None:
    _, token = KeyRing(tmp_path).add("panel", Role.VIEW)
    path = tmp_path / "keys.json"
    assert token.split("_", 2)[2] not in path.read_text()
    assert stat.S_IMODE(path.stat().st_mode) == 0o600


def test_a_change_by_another_process_holds_at_once(tmp_path: Path) -> None:
    here, there = KeyRing(tmp_path), KeyRing(tmp_path)
    assert here.all_keys() == []
    key, token = there.add("panel", Role.VIEW)
    assert here.find(token) == key
    there.remove("panel")
    assert here.find(token) is None


def test_names_are_used_once_and_what_is_absent_is_said(tmp_path: Path) -> None:
    ring = KeyRing(tmp_path)
    key, _ = ring.add("panel", Role.VIEW)
    with pytest.raises(InputError, match="there is one of this name"):
        ring.add("panel", Role.VIEW)
    assert ring.remove(key.id) == key
    with pytest.raises(InputError, match="does not exist"):
        ring.remove("panel")


def test_keys_are_made_listed_and_removed_from_the_command_line(tmp_path: Path) -> None:
    def say(*arguments: str) -> str:
        done = CliRunner().invoke(cli, ["keys", *arguments, "--data", str(tmp_path)])
        assert done.exit_code == 0, done.output
        return done.output

    made = json.loads(say("add", "panel", "--role", "operate", "--json"))
    key = KeyRing(tmp_path).find(made["token"])
    assert key is not None
    assert (key.id, key.name, key.role) == (made["id"], "panel", "operate")
    assert say("list").splitlines()[1].split()[::3] == [key.id, "panel"]
    assert json.loads(say("list", "--json"))["items"] == [{k: v for k, v in made.items() if k != "token"}]
    assert say("remove", "panel") == "removed panel\n"
    assert say("list") == ""
    with Journal.open(journal_path(tmp_path)) as journal:
        assert [event.data["act"] for event in journal.events()] == ["keys add panel", "keys remove panel"]

