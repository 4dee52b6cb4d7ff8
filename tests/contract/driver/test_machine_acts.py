"""What the port asks of the controller beside streaming: homing, latch, limits, inputs, stamps, and who listens."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from ibfctl_simulator.galil.clock import ScaledClock
from ibfctl_simulator.galil.controller import Controller
from ibfctl_simulator.galil.inprocess import EmulatorServer
from ibfctl_simulator.galil.settings import Settings
from ibfctl_simulator.galil.switches import SwitchPlaces
from support.programs import connected, machine, program

from ibfctl.errors import ControllerError
from ibfctl.machine.controller import MotionController
from ibfctl.machine.description import MachineDescription
from ibfctl.runs.drivers import connect

SPEED = 20.0
PATIENCE_S = 20.0


@pytest.fixture
def server() -> Iterator[EmulatorServer]:
    settings = Settings(axes=2, switches=SwitchPlaces(home=3000, index_period=400))
    with EmulatorServer(Controller(settings), ScaledClock(SPEED)) as emulator:
        yield emulator


def bench(server: EmulatorServer, method: str = "absolute") -> MachineDescription:
    here = machine(port=server.port)
    axis = here.axes["A"].model_copy(update={"home_mm": -12.5})
    homing = here.homing.model_copy(update={"method": method})
    return here.model_copy(update={"homing": homing, "axes": {**here.axes, "A": axis}})


@pytest.fixture
def controller(server: EmulatorServer) -> Iterator[MotionController]:
    with connected(bench(server)) as made:
        yield made


@pytest.mark.parametrize(("method", "found_at"), [("switch", 3200), ("index", 400)])
def test_homing_finds_the_place_and_is_forgotten_without_power(
    server: EmulatorServer, method: str, found_at: int
) -> None:
    with connected(bench(server, method)) as controller:
        controller.servo_on()
        assert controller.homed() == {"A": False, "B": False}
        controller.home()
        assert controller.homed() == {"A": True, "B": True}
        assert {letter: axis.position_counts for letter, axis in controller.status().items()} == {"A": -12500, "B": 0}
        assert server.call(lambda: server.controller.state.axes[0].physical_counts) == pytest.approx(found_at, abs=60)
    server.fault("power-cycle")
    with connected(bench(server, method)) as controller:
        assert controller.homed() == {"A": False, "B": False}


def test_an_axis_that_does_not_find_its_home_place_is_not_homed(server: EmulatorServer) -> None:
    with connected(bench(server, "switch")) as controller:
        controller.servo_on()
        server.fault("limit axis=A side=forward")
        with pytest.raises(ControllerError):
            controller.home()
        assert not controller.homed()["A"]


def test_a_latched_emergency_stop_refuses_every_move(server: EmulatorServer, controller: MotionController) -> None:
    controller.servo_on()
    assert not controller.latched()
    controller.estop()
    assert controller.latched()
    for move in (
        controller.servo_on,
        controller.home,
        lambda: controller.move_to({"A": 10}),
        lambda: controller.prepare_segments(program(3)),
    ):
        with pytest.raises(ControllerError, match="latched"):
            move()
    with connected(bench(server)) as another:
        assert another.latched(), "a new connection does not forget it"


def test_limits_and_inputs_read_back(server: EmulatorServer, controller: MotionController) -> None:
    server.call(lambda: server.controller.state.axes[1].parameters.__setitem__("BL", -700.0))
    assert controller.soft_limits() == {"A": (-(2**31), 2**31 - 1), "B": (-700, 2**31 - 1)}
    server.fault("input number=12 level=0")
    server.fault("analog number=3 volts=-4.5")
    assert controller.read_inputs([11, 12], [3]) == ([1, 0], [-4.5])


def begin(
    controller: MotionController,
    segments: int,
    open_at: int,
    close_at: int,
    *,
    end: bool = True,
    patience_s: float = PATIENCE_S,
) -> None:
    job = program(segments)
    controller.servo_on()
    controller.move_to({letter: axis.start_counts for letter, axis in job.axes.items()})
    controller.start_guard(patience_s)
    controller.prepare_segments(job)
    controller.queue_segments(job, 0, segments)
    if end:
        controller.queue_end()
    controller.begin_segments(open_at, close_at)


def poll_until_rest(controller: MotionController) -> set[int]:
    codes = {30}
    while 30 in codes:
        codes = set(controller.buffer_status().stop_codes.values())
    return codes


@pytest.mark.parametrize(("open_at", "close_at"), [(0, 40), (0, 17), (7, 40), (7, 8), (30, 35)])
def test_the_gate_opens_and_closes_at_segments_to_the_sample(
    controller: MotionController, open_at: int, close_at: int
) -> None:
    begin(controller, 40, open_at, close_at)
    assert poll_until_rest(controller) == {31}
    stamps = controller.stamps()
    assert stamps.begun is not None
    assert stamps.opened is not None
    assert stamps.closed is not None
    assert (stamps.opened - stamps.begun, stamps.closed - stamps.begun) == (60 * open_at, 60 * close_at)
    assert not controller.gate_is_open()


def test_a_closed_gate_is_not_opened_again_by_the_controller(controller: MotionController) -> None:
    begin(controller, 60, 30, 60)
    controller.close_gate()
    assert poll_until_rest(controller) == {31}
    assert controller.stamps().opened is None


def test_the_first_closing_is_the_one_that_is_stamped(controller: MotionController) -> None:
    begin(controller, 40, 0, 20)
    poll_until_rest(controller)
    first = controller.stamps().closed
    controller.close_gate()
    assert controller.stamps().closed == first


def test_the_guard_closes_the_gate_before_a_buffer_that_nobody_feeds_is_empty(controller: MotionController) -> None:
    begin(controller, 60, 0, 60, end=False)
    stopped_by_the_guard = 4
    assert poll_until_rest(controller) == {stopped_by_the_guard}
    stamps = controller.stamps()
    assert stamps.begun is not None
    assert stamps.closed is not None
    assert controller.buffer_status().guard_reason == "the buffer was about to run empty"
    assert 50 * 60 < stamps.closed - stamps.begun < 60 * 60


def test_the_guard_closes_the_gate_when_the_host_falls_silent(
    server: EmulatorServer, controller: MotionController
) -> None:
    begin(controller, 250, 0, 250, patience_s=5.0)
    with connected(bench(server)) as console:
        while console.gate_is_open():
            pass
    status = controller.buffer_status()
    assert status.guard_reason == "the host was silent for too long"
    assert set(status.stop_codes.values()) == {4}


def test_a_halt_closes_the_gate_and_then_decelerates(controller: MotionController) -> None:
    begin(controller, 200, 0, 200)
    controller.halt()
    assert poll_until_rest(controller) == {4}
    assert not controller.gate_is_open()


def test_whose_guard_runs_is_known_by_its_age(server: EmulatorServer, controller: MotionController) -> None:
    assert controller.guard_owner_age_s() is None
    controller.start_guard(PATIENCE_S)
    with connected(bench(server)) as another:
        age_s = another.guard_owner_age_s()
        assert age_s is not None
        assert age_s >= 0
        controller.stop_guard()
        assert another.guard_owner_age_s() is None


def test_an_observer_is_told_of_everything(server: EmulatorServer) -> None:
    told: list[tuple[str, str, str]] = []
    controller = connect(bench(server), lambda handle, sent, reply, at_s: told.append((handle, sent, reply)))
    try:
        begin(controller, 40, 0, 40)
        controller.abort()
    finally:
        controller.close()
    assert ("status", "TC1", "0:") in told
    (batch,) = [(sent, reply) for handle, sent, reply in told if sent.startswith("segments")]
    assert batch[0].startswith("segments 0 to 39, 80 lines, sha256 ")
    assert batch[1] == ":"
    assert ("stream", "gcls=0\rSB 1\rBT AB\rgbeg=TIME\rgopn=gbeg\rXQ #IBFCLS,1", "::::::") in told
    assert [handle for handle, sent, _ in told if "AB\r" in sent and sent.startswith("CB 1")] == ["abort"]
