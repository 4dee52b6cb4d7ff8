"""The machine file: what it must hold, and the one line that says what is wrong with it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from ibfctl.errors import InputError
from ibfctl.machine.description import parse_machine, read_machine
from ibfctl.machine.shipped import shipped_machine

GOOD = """
name = "bench"
sample_period_s = 0.0009765625

[axes.A]
coordinate = "x"
counts_per_mm = 1000
direction = -1
travel_min_mm = -10.0
travel_max_mm = 20.0
v_max_mm_s = 250.0
a_max_mm_s2 = 2000.0

[axes.C]
coordinate = "y"
counts_per_mm = 500.5
travel_min_mm = -5
travel_max_mm = 5
v_max_mm_s = 150.0
a_max_mm_s2 = 1000.0

[beam_gate]
output = 3
"""


def test_a_good_file_and_its_defaults() -> None:
    machine = parse_machine(GOOD, "bench.toml")
    assert machine.letter_of("x") == "A"
    assert machine.letter_of("y") == "C"
    assert machine.axis_of("x").signed_counts_per_mm == -1000
    assert machine.axis_of("y").signed_counts_per_mm == 500.5
    assert machine.sample_period_s == 1 / 1024
    assert machine.beam_gate.open_when == "set"
    assert machine.connection.driver == "galil"


def test_the_sample_period_is_galils_by_default() -> None:
    text = GOOD.replace("sample_period_s = 0.0009765625\n", "")
    assert parse_machine(text, "bench.toml").sample_period_s == 1 / 1024


@pytest.mark.parametrize(
    ("name", "x", "y"),
    [
        ("nsls2-ibf", (250.0, 2000.0), (150.0, 1000.0)),
        ("simulator", (250.0, 2000.0), (150.0, 1000.0)),
    ],
)
def test_the_shipped_files_hold_the_published_stages(name: str, x: tuple[float, float], y: tuple[float, float]) -> None:
    machine = read_machine(shipped_machine(name))
    assert (machine.axis_of("x").v_max_mm_s, machine.axis_of("x").a_max_mm_s2) == x
    assert (machine.axis_of("y").v_max_mm_s, machine.axis_of("y").a_max_mm_s2) == y
    assert machine.sample_period_s == 1 / 1024


BAD = {
    "unknown key at the top": ('name = "bench"', 'name = "bench"\ncolour = "red"', "colour"),
    "unknown key of an axis": ("direction = -1", "direction = -1\njerk_max = 5", "axes.A.jerk_max"),
    "unknown section": ("[beam_gate]", "[turbo]\nboost = 2\n[beam_gate]", "turbo"),
    "unknown axis letter": ("[axes.C]", "[axes.Z]", "axes.Z"),
    "lower-case axis letter": ("[axes.C]", "[axes.c]", "axes.c"),
    "missing limit": ("v_max_mm_s = 150.0\n", "", "axes.C.v_max_mm_s"),
    "missing scale": ("counts_per_mm = 1000\n", "", "axes.A.counts_per_mm"),
    "missing gate": ("[beam_gate]\noutput = 3", "", "beam_gate"),
    "missing name": ('name = "bench"', "", "name"),
    "negative speed limit": ("v_max_mm_s = 250.0", "v_max_mm_s = -250.0", "axes.A.v_max_mm_s"),
    "speed limit of zero": ("v_max_mm_s = 250.0", "v_max_mm_s = 0", "axes.A.v_max_mm_s"),
    "negative acceleration limit": ("a_max_mm_s2 = 2000.0", "a_max_mm_s2 = -1", "axes.A.a_max_mm_s2"),
    "infinite acceleration limit": ("a_max_mm_s2 = 2000.0", "a_max_mm_s2 = inf", "axes.A.a_max_mm_s2"),
    "speed limit that is no number": ("v_max_mm_s = 250.0", "v_max_mm_s = nan", "axes.A.v_max_mm_s"),
    "negative scale": ("counts_per_mm = 1000", "counts_per_mm = -1000", "axes.A.counts_per_mm"),
    "direction of two": ("direction = -1", "direction = 2", "axes.A.direction"),
    "travel inside out": ("travel_max_mm = 20.0", "travel_max_mm = -20.0", "travel_min_mm must be smaller"),
    "travel of nothing": ("travel_max_mm = 20.0", "travel_max_mm = -10.0", "travel_min_mm must be smaller"),
    "travel without end": ("travel_max_mm = 20.0", "travel_max_mm = inf", "axes.A.travel_max_mm"),
    "sample period of zero": ("sample_period_s = 0.0009765625", "sample_period_s = 0", "sample_period_s"),
    "unknown coordinate": ('coordinate = "y"', 'coordinate = "z"', "axes.C.coordinate"),
    "two axes for x": ('coordinate = "y"', 'coordinate = "x"', "one axis for x and one for y"),
    "gate output of zero": ("output = 3", "output = 0", "beam_gate.output"),
    "gate of another sense": ("output = 3", 'output = 3\nopen_when = "high"', "beam_gate.open_when"),
    "port of zero": ("[beam_gate]", "[connection]\nport = 0\n[beam_gate]", "connection.port"),
    "no TOML": ("[axes.A]", "[axes.A", "not valid TOML"),
}


@pytest.mark.parametrize("case", BAD, ids=str)
def test_a_bad_file_ends_in_one_line_that_names_file_and_key(case: str) -> None:
    old, new, named = BAD[case]
    assert old in GOOD
    with pytest.raises(InputError, match=re.escape(named)) as caught:
        parse_machine(GOOD.replace(old, new), "bench.toml")
    assert caught.value.message.startswith("machine file bench.toml: ")
    assert "\n" not in str(caught.value)
    assert caught.value.hint


def test_a_machine_without_an_axis_for_y() -> None:
    text = GOOD[: GOOD.index("[axes.C]")] + GOOD[GOOD.index("[beam_gate]") :]
    with pytest.raises(InputError, match="one axis for x and one for y"):
        parse_machine(text, "bench.toml")


def test_several_mistakes_are_counted() -> None:
    text = GOOD.replace("v_max_mm_s = 250.0", "v_max_mm_s = -1").replace("output = 3", "output = 0")
    with pytest.raises(InputError, match=r"and 1 more"):
        parse_machine(text, "bench.toml")


@pytest.mark.parametrize("content", [None, b"\xff\xfe\x00name", b"\x00\x01"])
def test_a_file_that_cannot_be_read(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "machine.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=re.escape(str(path))):
        read_machine(path)


def test_a_folder_is_no_machine_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        read_machine(tmp_path)


def test_a_machine_that_is_not_shipped() -> None:
    with pytest.raises(InputError, match="does not come with"):
        shipped_machine("no-such-machine")


def test_a_description_cannot_be_changed_afterwards() -> None:
    axis = parse_machine(GOOD, "bench.toml").axis_of("x")
    with pytest.raises(ValueError, match="frozen"):
        axis.v_max_mm_s = 1e9  # type: ignore[misc]


INTERLOCK = """
[[interlocks]]
name = "beam current"
source = "analog 2"
min = 4.5
max = 5.5
"""


def test_interlocks_name_their_inputs() -> None:
    machine = parse_machine(f'{GOOD}{INTERLOCK}[[interlocks]]\nname = "x"\nsource = "pushed"\nmin = 0\nmax = 0\n', "m")
    current, pushed = machine.interlocks
    assert (current.kind, current.number, current.settle_s) == ("analog", 2, None)
    assert (pushed.kind, pushed.number) == ("pushed", 0)
    assert type(machine).model_validate_json(machine.model_dump_json()) == machine


@pytest.mark.parametrize(
    ("there", "instead", "place"),
    [
        ("analog 2", "analog 9", "interlocks.0.source"),
        ("analog 2", "digital 81", "interlocks.0.source"),
        ("analog 2", "analogue", "interlocks.0.source"),
        ("min = 4.5", "min = 6.0", "interlocks.0"),
        ('name = "beam current"', 'name = ""', "interlocks.0.name"),
    ],
)
def test_an_interlock_that_cannot_be_is_refused(there: str, instead: str, place: str) -> None:
    with pytest.raises(InputError, match=re.escape(place)):
        parse_machine(GOOD + INTERLOCK.replace(there, instead), "bench.toml")


def test_interlocks_of_one_name_are_refused() -> None:
    with pytest.raises(InputError, match="different names"):
        parse_machine(GOOD + 2 * INTERLOCK, "bench.toml")


def test_a_machine_must_be_homed_unless_its_encoders_know() -> None:
    assert parse_machine(GOOD, "bench.toml").homing.method == "switch"
    assert read_machine(shipped_machine("simulator")).homing.method == "absolute"
    with pytest.raises(InputError, match=r"homing\.method"):
        parse_machine(f'{GOOD}[homing]\nmethod = "by eye"\n', "bench.toml")
