"""After a stop, an abort or an e-stop with full buffers nothing moves, whatever waits in the controller."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import pytest
from ibfctl_simulator.galil.clock import ScaledClock
from ibfctl_simulator.galil.controller import Controller
from ibfctl_simulator.galil.inprocess import EmulatorServer
from ibfctl_simulator.galil.settings import Settings
from support.plans import plan_of
from support.programs import connected, machine, program

from ibfctl.runs.conductor import conduct
from ibfctl.runs.requests import Requests
from ibfctl.runs.states import RunState

SPEED = 10.0
SEGMENTS, TIME_SAMPLES = 700, 60
FULL = 200
"""Segments that wait when the order comes: the controller holds 255."""

ENDS: dict[RunState, Callable[[Requests], None]] = {
    RunState.STOPPED: lambda requests: requests.stop(),
    RunState.ABORTED: lambda requests: requests.abort.set(),
    RunState.ESTOPPED: lambda requests: requests.estop(),
}


@pytest.mark.parametrize("end", ENDS)
def test_nothing_moves_after(end: RunState) -> None:
    waiting: list[int] = []
    requests = Requests()
    controller = Controller(Settings(axes=2))

    def report(kind: str, data: Mapping[str, object]) -> None:
        sent, executed = data.get("sent"), data.get("executed")
        if kind == "progress" and not waiting and isinstance(sent, int) and isinstance(executed, int) and executed > 20:
            waiting.append(sent - executed)
            ENDS[end](requests)

    with EmulatorServer(controller, ScaledClock(SPEED)) as server:
        bench = machine(port=server.port)

        def places() -> list[int]:
            return server.call(lambda: [axis.encoder_counts for axis in controller.state.axes])

        with connected(bench) as link:
            result = conduct(plan_of(program(SEGMENTS, TIME_SAMPLES)), bench, link, requests, report, time_scale=SPEED)
            at_the_end = places()
            server.call(lambda: controller.advance(SEGMENTS * TIME_SAMPLES))
            assert places() == at_the_end
        with connected(bench):  # whoever comes next moves nothing by coming
            server.call(lambda: controller.advance(SEGMENTS * TIME_SAMPLES))
            assert places() == at_the_end
        assert not server.call(lambda: controller.state.outputs & 1)
    assert result.state is end
    assert waiting[0] > FULL
