from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import cast

from ibfctl.machine.controller import MotionController
from ibfctl.machine.description import Interlock
from ibfctl.runs.interlocks import Interlocks
from ibfctl.runs.requests import Requests, When


class Inputs:
    """A controller that has only inputs."""

    def __init__(self) -> None:
        self.digital: dict[int, int] = {4: 1}
        self.analog: dict[int, float] = {2: 5.0}

    def read_inputs(self, digital: Sequence[int], analog: Sequence[int]) -> tuple[list[int], list[float]]:
        return [self.digital[n] for n in digital], [self.analog[n] for n in analog]


def interlock(source: str, **more: object) -> Interlock:
    fields = {"name": source, "source": source, "min": 0.5, "max": 5.5, **more}
    return Interlock.model_validate(fields)


class Bench:
    def __init__(self, *interlocks: Interlock) -> None:
        self.inputs, self.requests = Inputs(), Requests()
        self.told: list[Mapping[str, object]] = []
        controller = cast(MotionController, self.inputs)
        self.watch = Interlocks(interlocks, controller, self.requests, lambda kind, data: self.told.append(data))

    def look(self) -> frozenset[str]:
        self.watch.look()
        return self.requests.held


def test_what_is_in_its_band_holds_nothing() -> None:
    bench = Bench(interlock("digital 4"), interlock("analog 2"))
    assert bench.look() == frozenset()
    assert bench.told == []
    assert bench.watch.values["analog 2"] == {"value": 5.0, "ok": True}


def test_each_is_read_from_its_own_input() -> None:
    bench = Bench(interlock("analog 2"), interlock("digital 4"))
    bench.inputs.digital[4] = 0
    assert bench.look() == {"digital 4"}
    assert bench.watch.bad == ["digital 4"]
    assert bench.requests.pause_wanted is When.NOW
    assert bench.told == [{"name": "digital 4", "value": 0.0, "ok": False}]


def test_without_a_settle_time_only_an_operator_lets_the_run_go_on() -> None:
    bench = Bench(interlock("analog 2"))
    bench.inputs.analog[2] = 9.0
    bench.look()
    bench.inputs.analog[2] = 5.0
    assert bench.look() == {"analog 2"}
    bench.requests.resume()
    assert bench.look() == frozenset()


def test_an_operator_cannot_overrule_what_is_still_out_of_its_band() -> None:
    bench = Bench(interlock("analog 2"))
    bench.inputs.analog[2] = 9.0
    bench.look()
    bench.requests.resume()
    assert bench.look() == {"analog 2"}


def test_with_a_settle_time_the_run_goes_on_by_itself_but_no_pause_of_an_operator_ends() -> None:
    bench = Bench(interlock("analog 2", settle_s=0.0))
    bench.inputs.analog[2] = -1.0
    assert bench.look() == {"analog 2"}
    bench.requests.pause(When.SAFE_POINT)
    bench.inputs.analog[2] = 1.0
    assert bench.look() == frozenset()
    assert bench.requests.pause_wanted is When.SAFE_POINT


def test_a_settle_time_begins_anew_with_every_fall() -> None:
    bench = Bench(interlock("analog 2", settle_s=1000.0))
    bench.inputs.analog[2] = 9.0
    bench.look()
    bench.inputs.analog[2] = 5.0
    assert bench.look() == {"analog 2"}


def test_a_pushed_value_grows_old() -> None:
    bench = Bench(interlock("pushed", stale_s=0.05))
    assert bench.look() == {"pushed"}, "none has come yet"
    bench.requests.resume()
    bench.requests.interlock("pushed", 1.0)
    assert bench.look() == frozenset()
    deadline = time.monotonic() + 5
    while not bench.look() and time.monotonic() < deadline:
        pass
    assert bench.requests.held == {"pushed"}
