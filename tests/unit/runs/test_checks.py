"""The preflight's list, on a controller that has only what each check asks for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import cast

import numpy as np
import pytest
from support.plans import plan_of
from support.programs import machine, program

from ibfctl.errors import StoppedError
from ibfctl.machine.controller import AxisStatus, ControllerIdentity, MotionController
from ibfctl.planning.plan import Plan
from ibfctl.runs.checks import ALONE, PreflightCheck, preflight
from ibfctl.runs.requests import Requests
from ibfctl.runs.rig import Rig
from ibfctl.runs.sentinel import Sentinel
from ibfctl.schedule.certificate import Certificate

JOB = program(60)


class Machine:
    """All is well, but for what a test changes."""

    def __init__(self) -> None:
        self.age_s: float | None = None
        self.is_latched = False
        self.known = {"A": True, "B": True}
        self.limits = {"A": (-(2**31), 2**31 - 1), "B": (-(2**31), 2**31 - 1)}
        self.on = False
        self.acts: list[str] = []

    def guard_owner_age_s(self) -> float | None:
        return self.age_s

    def close_gate(self) -> None:
        self.acts.append("close")

    def identify(self) -> ControllerIdentity:
        return ControllerIdentity("DMC4020", 2)

    def latched(self) -> bool:
        return self.is_latched

    def start_guard(self, patience_s: float) -> None:
        self.acts.append("guard")

    def stop_guard(self) -> None:
        self.acts.append("no guard")

    def measure_sample_period_s(self, duration_s: float) -> float:
        return 1 / 1024

    def homed(self) -> Mapping[str, bool]:
        return self.known

    def soft_limits(self) -> Mapping[str, tuple[int, int]]:
        return self.limits

    def servo_on(self) -> None:
        self.on = True

    def status(self) -> Mapping[str, AxisStatus]:
        return {letter: AxisStatus(0, 0, 1, moving=False, motor_on=self.on) for letter in "AB"}


def looked_at(bench: Machine, plan: Plan | None = None, requests: Requests | None = None) -> list[PreflightCheck]:
    controller, wanted = cast(MotionController, bench), requests or Requests()
    rig = Rig(machine(), controller, wanted, Sentinel(controller, wanted))
    return list(preflight(plan or plan_of(JOB), rig, None))


def wrong(bench: Machine, plan: Plan | None = None) -> list[str]:
    return [check.name for check in looked_at(bench, plan) if not check.ok]


def test_a_machine_that_is_ready() -> None:
    bench = Machine()
    assert wrong(bench) == []
    assert bench.acts == ["close", "guard", "no guard"]
    assert bench.on


def test_whoever_is_not_alone_touches_nothing() -> None:
    bench = Machine()
    bench.age_s = 0.3
    assert [check.name for check in looked_at(bench)] == [ALONE]
    assert (bench.acts, bench.on) == ([], False)


def test_a_guard_whose_host_is_long_gone_is_taken_over() -> None:
    bench = Machine()
    bench.age_s = 60.0
    assert wrong(bench) == []


def test_nothing_is_switched_on_unless_all_is_well() -> None:
    bench = Machine()
    bench.known = {"A": True, "B": False}
    assert wrong(bench) == ["homed"]
    assert not bench.on


def test_a_latched_emergency_stop_is_named() -> None:
    bench = Machine()
    bench.is_latched = True
    assert wrong(bench) == ["emergency stop"]


def test_soft_limits_count_where_a_cubic_bulges_beyond_its_nodes() -> None:
    bench = Machine()
    axis = JOB.axes["A"]
    nodes = axis.start_counts + np.concatenate([[0], np.cumsum(axis.increment_counts)])
    bench.limits["A"] = (int(nodes.min()) - 1000, int(nodes.max()))
    assert wrong(bench) == ["soft limits"]


def test_a_plan_is_certified_anew() -> None:
    plan = plan_of(JOB)
    axis = JOB.axes["A"]
    moved = axis.increment_counts.copy()
    moved[[10, 11]] += np.array([700, -700])
    other = replace(JOB, axes={**JOB.axes, "A": replace(axis, increment_counts=moved)})
    assert "certificate" in wrong(Machine(), replace(plan, program=other))
    assert "certificate" in wrong(Machine(), replace(plan, certificate=Certificate(())))
    path = replace(plan.path, x_mm=plan.path.x_mm + 0.01)
    assert wrong(Machine(), replace(plan, path=path)) == ["certificate"]


def test_a_stop_ends_the_preflight() -> None:
    requests = Requests()
    requests.stop()
    with pytest.raises(StoppedError):
        looked_at(Machine(), requests=requests)
