"""Runs of a small plan on an emulated controller, as the worker process does them."""

from __future__ import annotations

from pathlib import Path

from ibfctl.machine.shipped import shipped_machine
from ibfctl.planning.file import write_plan
from ibfctl.runs.job import Address, Job, prepare
from support.plans import plan_of
from support.programs import program


def small_run(data: Path, port: int, speed: float, run: str = "r1", segments: int = 900) -> Path:
    """Make the folder of a run of a wave of `segments` segments of 60 samples."""
    write_plan(plan_of(program(segments)), data / "plan.h5")
    text = shipped_machine("simulator").read_text()
    for old, new in (
        ("counts_per_mm = 10000", "counts_per_mm = 1000"),
        ("approach_speed_mm_s = 20.0", "approach_speed_mm_s = 50.0"),
    ):
        text = text.replace(old, new)
    (data / "machine.toml").write_text(text)
    address = Address(host="127.0.0.1", port=port)
    job = Job(run=run, operator="ann", key="k1", simulated=True, speed=speed, address=address)
    return prepare(data, job, data / "plan.h5", data / "machine.toml")
