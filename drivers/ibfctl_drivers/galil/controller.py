"""The product's port on a Galil controller, over four handles or one serial line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ibfctl.errors import ControllerError, LinkError
from ibfctl.machine.controller import AxisStatus, BufferStatus, ControllerIdentity, Observer, Stamps
from ibfctl.machine.description import MachineDescription
from ibfctl.machine.program import MotionProgram
from ibfctl_drivers.galil import codec
from ibfctl_drivers.galil.abort import AbortLine
from ibfctl_drivers.galil.approach import Approach
from ibfctl_drivers.galil.axes import AxisReader
from ibfctl_drivers.galil.clock import sample_period_s
from ibfctl_drivers.galil.gate import GateOutput
from ibfctl_drivers.galil.greeting import greet, identify
from ibfctl_drivers.galil.guard import CLOSER, OPENER, SIGN_OF_LIFE, THREAD_RUNS, Guard, guard_lines
from ibfctl_drivers.galil.handles import handles_to
from ibfctl_drivers.galil.link import Link, RejectedError
from ibfctl_drivers.galil.segments import PLACES, SegmentMode, low_water, mode_for

LATCH = "gestop"
PROBE = "gprobe=0"
STAMPS = ("gbeg", "gopn", "gcls")


def connect(machine: MachineDescription, on_exchange: Observer | None = None) -> GalilController:
    """Connect to the controller that the machine file names.

    Parameters
    ----------
    machine
        Where it is, and what it moves.
    on_exchange
        Told of everything that goes over the wire; see `Observer`.

    Raises
    ------
    LinkError
        If it cannot be reached or does not speak the protocol.
    """
    controller = GalilController(machine, on_exchange)
    try:
        controller.greet()
    except BaseException:
        controller.close()
        raise
    return controller


class GalilController:
    """A connected Galil controller; see `ibfctl.machine.controller.MotionController` for the contract.

    The handles are opened in the order stream, status, gate, abort. PV lines and begin use the stream handle,
    questions and all else the status handle; the gate shares its own with the signs of life alone, and the abort has
    one to itself: of the eight that there are, a second program needs four too. On a serial line all four are one; an
    abort then breaks into it, and the line is opened anew.
    """

    buffer_places = PLACES

    def __init__(self, machine: MachineDescription, on_exchange: Observer | None = None) -> None:
        self._handles = handles_to(machine.connection, on_exchange)
        self._letters = "".join(sorted(machine.axes))
        self._free = dict.fromkeys(self._letters, 0)
        self._queued = 0
        self._prepared: SegmentMode | None = None
        self._low_water = 0
        self._closed = False
        self._links: list[Link] = []
        try:
            self._stream = self._open("stream")
            self._status = self._open("status")
            self._gate = GateOutput(machine.beam_gate, lambda: self._open("gate"))
            self._abort = AbortLine(self._gate, lambda: self._open("abort"), shared=self._handles.shared)
            self._reader = AxisReader(self._status)
            self._approach = Approach(machine, self._status, self._reader)
            self._guard = Guard(self._status, guard_lines(self._letters, self._gate))
        except BaseException:
            self.close()
            raise

    def greet(self) -> None:
        """Have unsolicited text marked on every handle, and clear an error latched by an earlier client."""
        greet(self._links, self._status)

    def identify(self) -> ControllerIdentity:
        """Ask who answers, and prove by asking that every axis of the job has a PVT buffer."""
        return identify(self._status, self._reader, self._letters)

    def measure_sample_period_s(self, duration_s: float) -> float:
        """Compare the controller's sample counter with the host's clock over `duration_s`."""
        return sample_period_s(lambda: self._reader.numbers(["TIME"])[0], duration_s)

    def servo_on(self) -> None:
        """Set the error limit and what follows from it, then switch the servos on."""
        self._refuse_if_latched()
        self._approach.servo_on()

    def servo_off(self) -> None:
        """Switch the servos of the job's axes off."""
        self._approach.servo_off()

    def move_to(self, position_counts: Mapping[str, int]) -> None:
        """Move at approach speed and wait; a later stop decelerates at the axes' own limit."""
        self._refuse_if_latched()
        self._approach.move_to(position_counts)

    def home(self) -> None:
        """Find the home place of every axis, and have the controller remember that as long as it has power."""
        self._refuse_if_latched()
        self._approach.home()

    def homed(self) -> Mapping[str, bool]:
        """Whether each axis knows where it is, since the controller has had power."""
        return self._approach.homed()

    def latched(self) -> bool:
        """Whether an emergency stop is latched on the controller."""
        return self._reader.variable(LATCH) == 1

    def soft_limits(self) -> Mapping[str, tuple[int, int]]:
        """Least and greatest position that the controller lets each axis reach (`BL`, `FL`)."""
        values = self._reader.numbers([f"_{name}{letter}" for letter in self._letters for name in ("BL", "FL")])
        return {letter: (values[2 * k], values[2 * k + 1]) for k, letter in enumerate(self._letters)}

    def read_inputs(self, digital: Sequence[int], analog: Sequence[int]) -> tuple[list[int], list[float]]:
        """Read inputs in one round trip: levels, and volts."""
        names = [f"@IN[{number}]" for number in digital] + [f"@AN[{number}]" for number in analog]
        question = codec.message_of(names)
        values = codec.parse_numbers(self._status.ask(question), len(names), question)
        return [int(value) for value in values[: len(digital)]], values[len(digital) :]

    def guard_owner_age_s(self) -> float | None:
        """Seconds since somebody last gave the guard a sign of life; None where no guard runs."""
        return self._guard.owner_age_s()

    def start_guard(self, patience_s: float) -> None:
        """Load the guard program, read it back and start it; from now on every poll is a sign of life."""
        self._guard.start(patience_s)

    def stop_guard(self) -> None:
        """Halt the guard program, so that the gate can be opened by hand again."""
        self._guard.stop()

    def prepare_segments(self, program: MotionProgram) -> None:
        """Enter the program's mode, see that the buffers are empty, and forget the stamps of the motion before."""
        self._refuse_if_latched()
        self._prepared, self._queued = mode_for(program), 0
        self._low_water = 0
        stamps = [f"{name}=0" for name in (*STAMPS, "gend")]
        commands = (*self._prepared.enter(), *stamps, f"glow={PLACES}")
        self._status.pipeline([f"{command}\r".encode("ascii") for command in commands])
        free = self.buffer_status().free_places
        if any(places != self.buffer_places for places in free.values()):
            raise ControllerError(f"segment buffers are not empty after clearing: free places {dict(free)}")

    def queue_segments(self, program: MotionProgram, first: int, last: int) -> None:
        """Send segments `first` to `last` (exclusive) of every axis and check every prompt."""
        lines = self._mode.lines(program, first, last)
        self._take_places(last - first)
        try:
            self._stream.pipeline(lines, told_as=f"segments {first} to {last - 1}")
        except RejectedError as refusal:
            raise self._after_refusal(self._mode.place_of(refusal.index, first)) from refusal
        self._tell_low_water(program, last)

    def _tell_low_water(self, program: MotionProgram, sent: int) -> None:
        """Tell the guard how few segments are too few, which depends on how long those last sent are."""
        low = low_water(program, self._guard.low_water_samples(), sent) if self._mode.shutter else 0
        if low != self._low_water:
            self._status.pipeline([f"glow={PLACES - low}\r".encode("ascii")])
            self._low_water = low

    def queue_end(self) -> None:
        """Send the end marker to every axis; from now on the guard lets the buffer run low."""
        self._take_places(1)
        try:
            self._stream.pipeline([*self._mode.end_lines(), b"gend=1\r"])
        except RejectedError as refusal:
            raise self._after_refusal("the end marker") from refusal

    def begin_segments(self, open_at: int, close_at: int) -> None:
        """Start all axes in one packet: with the gate, or with the thread that opens it at a segment."""
        lines = [self._mode.begin(), "gbeg=TIME"]
        if not open_at:
            lines = [self._gate.open_command, *lines, "gopn=gbeg"]
        lines = ["gcls=0", *lines]  # somebody may have closed the gate while the buffer was being filled
        if self._mode.shutter:
            self._status.pipeline([f"gopen={open_at}\r".encode("ascii"), f"gclose={close_at}\r".encode("ascii")])
            lines.append(f"XQ {OPENER if open_at else CLOSER},1")
        elif open_at:
            raise ControllerError("a contour's gate opens with its begin", "run it from its begin")
        self._status.tell(SIGN_OF_LIFE)
        try:
            self._stream.pipeline([f"{line}\r".encode("ascii") for line in lines])
        except RejectedError as refusal:
            raise self._after_refusal(repr(lines[refusal.index])) from refusal
        except LinkError:
            self._gate.close()
            raise
        # A very short motion may be over, and its gate closed again, by now.
        if not open_at and not self._gate.is_open() and self.stamps().closed is None:
            raise ControllerError("the beam gate did not open", "check its output and wiring")

    def sign_of_life(self) -> bool:
        """Tell the guard that the host lives; return whether it runs."""
        return self._gate.tell_and_ask(SIGN_OF_LIFE, THREAD_RUNS) >= 0

    def limit_replies(self, timeout_s: float | None) -> None:
        """Wait less long for replies to the stream and to questions; on a serial line the gate would wait for them."""
        if not self._handles.shared:
            for link in (self._stream, self._status):
                link.limit(timeout_s)

    def check_stream(self) -> None:
        """Have the stream's handle answer something that changes nothing, and is no sign of life."""
        self._stream.tell(PROBE)

    def set_close_at(self, segment: int) -> None:
        """Have the gate closed on the controller when so many segments are over."""
        self._status.tell(f"gclose={segment}")

    def stamps(self) -> Stamps:
        """Read when the motion began and when the gate opened and closed, over whichever handle still answers."""
        names = [*STAMPS, "TIME"]
        try:
            begun, opened, closed, now = self._gate.numbers(names)
        except LinkError:
            begun, opened, closed, now = self._reader.numbers(names)
        return Stamps(begun or None, opened or None, closed or None, now)

    def buffer_status(self) -> BufferStatus:
        """Poll all that the streamer needs in one round trip."""
        letters, counts = self._letters, self._mode.operands()
        others = [*(f"_SC{letter}" for letter in letters), *(f"_TP{letter}" for letter in letters)]
        names = [*counts, *others, THREAD_RUNS, "TIME", self._gate.operand]
        values = self._reader.numbers(names)
        executed, free = self._mode.counts(values[: len(counts)], self._queued)
        self._free = dict(zip(letters, free, strict=True))
        codes = values[len(counts) :]
        return BufferStatus(
            free_places=dict(self._free),
            executed_segments=dict(zip(letters, executed, strict=True)),
            stop_codes=dict(zip(letters, codes, strict=False)),
            position_counts=dict(zip(letters, codes[len(letters) :], strict=False)),
            guard_runs=values[-3] >= 0,
            guard_reason="" if values[-3] >= 0 else self._guard.reason(),
            time_samples=values[-2],
            gate_open=self._gate.means_open(values[-1]),
        )

    def status(self) -> Mapping[str, AxisStatus]:
        """Full status of every axis of the job, one round trip per axis."""
        return {letter: self._reader.status(letter) for letter in self._letters}

    def close_gate(self) -> None:
        """Close the gate and read it back, on fresh handles if need be."""
        self._gate.close()

    def gate_is_open(self) -> bool:
        """Read the gate output back from the controller."""
        return self._gate.is_open()

    def stop(self) -> None:
        """Decelerate all axes of the job to rest and wait until they stand."""
        self._approach.stop()

    def halt(self) -> None:
        """Close the gate, read it back, and only then decelerate the axes; waits for no other handle."""
        self._gate.close(then=f"ST {self._letters}")

    def abort(self) -> None:
        """Close the gate and stop without deceleration; the bytes leave before anything is waited for."""
        self._abort()

    def estop(self) -> None:
        """Abort, switch the motors off, and latch that on the controller until it loses its power."""
        self._abort(f"MO {self._letters}", f"{LATCH}=1")

    def close(self) -> None:
        """Close all handles; never raises."""
        self._closed = True
        for link in self._links:
            link.close()

    @property
    def _mode(self) -> SegmentMode:
        if self._prepared is None:
            raise ControllerError("no program has been prepared")
        return self._prepared

    def _open(self, name: str) -> Link:
        if self._closed:
            raise LinkError(f"{name} link: the controller has been disconnected", "connect again")
        link = self._handles.open(name)
        if link not in self._links:
            self._links.append(link)
        return link

    def _refuse_if_latched(self) -> None:
        if self.latched():
            raise ControllerError(
                "an emergency stop is latched on the controller; nothing moves",
                "find out why, make the machine safe, switch the controller off and on, and home it",
            )

    def _take_places(self, places: int) -> None:
        """Book places that the last poll saw free: a PV line is never sent to a full buffer."""
        if places > min(self._free.values()):
            raise ControllerError(f"{places} segments do not fit into free places {self._free}")
        for letter in self._free:
            self._free[letter] -= places
        self._queued += places

    def _after_refusal(self, what: str) -> RejectedError:
        self._gate.close()
        self._free = dict.fromkeys(self._letters, 0)
        reason = self._stream.ask("TC1")
        return RejectedError(
            f"controller refused {what}: {reason or 'no reason given'}",
            "the gate is closed; look the code up in the controller's command reference",
        )
