"""The product's port on a Galil controller, over four handles or one serial line."""

from __future__ import annotations

import logging
from collections.abc import Mapping

from ibfctl.errors import ControllerError, LinkError
from ibfctl.machine.controller import AxisStatus, BufferStatus, ControllerIdentity
from ibfctl.machine.description import MachineDescription
from ibfctl.machine.program import MotionProgram
from ibfctl_drivers.galil import codec
from ibfctl_drivers.galil.approach import Approach
from ibfctl_drivers.galil.axes import AxisReader
from ibfctl_drivers.galil.clock import sample_period_s
from ibfctl_drivers.galil.gate import GateOutput
from ibfctl_drivers.galil.guard import THREAD_RUNS, Guard, guard_lines
from ibfctl_drivers.galil.handles import handles_to
from ibfctl_drivers.galil.link import Link, RejectedError
from ibfctl_drivers.galil.segments import PLACES, SegmentMode, mode_for

_log = logging.getLogger(__name__)


def connect(machine: MachineDescription) -> GalilController:
    """Connect to the controller that the machine file names.

    Raises
    ------
    LinkError
        If it cannot be reached or does not speak the protocol.
    """
    controller = GalilController(machine)
    try:
        controller.greet()
    except BaseException:
        controller.close()
        raise
    return controller


class GalilController:
    """A connected Galil controller; see `ibfctl.machine.controller.MotionController` for the contract.

    The handles are opened in the order stream, status, gate, abort. PV lines and begin use the stream
    handle, questions and all else the status handle; the gate and abort have theirs to themselves. On a
    serial line all four are one; an abort then breaks into it, and the line is opened anew.
    """

    buffer_places = PLACES

    def __init__(self, machine: MachineDescription) -> None:
        self._handles = handles_to(machine.connection)
        self._letters = "".join(sorted(machine.axes))
        self._free = dict.fromkeys(self._letters, 0)
        self._queued = 0
        self._prepared: SegmentMode | None = None
        self._closed = False
        self._links: list[Link] = []
        try:
            self._stream = self._open("stream")
            self._status = self._open("status")
            self._gate = GateOutput(machine.beam_gate, lambda: self._open("gate"))
            self._abort = self._open("abort")
            self._reader = AxisReader(self._status)
            self._approach = Approach(machine, self._status, self._reader)
            lines = guard_lines(self._letters, self._gate.close_command, self._gate.closed_condition)
            self._guard = Guard(self._status, lines)
        except BaseException:
            self.close()
            raise

    def greet(self) -> None:
        """Have unsolicited text marked on every handle, and clear an error latched by an earlier client."""
        for link in self._links:
            try:
                link.tell("CW 1")
            except RejectedError as refusal:  # unsolicited text will then break the framing: still safe
                _log.warning("unsolicited text stays unmarked: %s", refusal)
        latched = self._status.ask("TC1")
        if not latched.startswith("0"):
            _log.info("error latched before this connection: %s", latched)

    def identify(self) -> ControllerIdentity:
        """Ask who answers, and prove by asking that every axis of the job has a PVT buffer."""
        text = self._status.ask(codec.IDENTIFY)
        model = codec.parse_identity(text)
        last = ord(self._letters[-1]) - ord("A") + 1
        if last > model.axes:
            raise ControllerError(
                f"controller {text!r} has {model.axes} axes, the machine file uses axis {self._letters[-1]}",
                "correct the axis letters in the machine file",
            )
        places = self._reader.numbers(f"_PV{letter}" for letter in self._letters)
        if not all(0 <= free <= self.buffer_places for free in places):
            raise ControllerError(f"controller {text!r} has no PVT buffer of {self.buffer_places} places")
        return ControllerIdentity(text, model.axes)

    def measure_sample_period_s(self, duration_s: float) -> float:
        """Compare the controller's sample counter with the host's clock over `duration_s`."""
        return sample_period_s(lambda: self._reader.numbers(["TIME"])[0], duration_s)

    def servo_on(self) -> None:
        """Set the error limit and what follows from it, then switch the servos on."""
        self._approach.servo_on()

    def servo_off(self) -> None:
        """Switch the servos of the job's axes off."""
        self._approach.servo_off()

    def move_to(self, position_counts: Mapping[str, int]) -> None:
        """Move at approach speed and wait; a later stop decelerates at the axes' own limit."""
        self._approach.move_to(position_counts)

    def start_guard(self, patience_s: float) -> None:
        """Load the guard program, read it back and start it; from now on every poll is a sign of life."""
        self._guard.start(patience_s)

    def stop_guard(self) -> None:
        """Halt the guard program, so that the gate can be opened by hand again."""
        self._guard.stop()

    def prepare_segments(self, program: MotionProgram) -> None:
        """Enter the program's mode and see that the buffers are empty."""
        self._prepared, self._queued = mode_for(program), 0
        for command in self._prepared.enter():
            self._status.tell(command)
        free = self.buffer_status().free_places
        if any(places != self.buffer_places for places in free.values()):
            raise ControllerError(f"segment buffers are not empty after clearing: free places {dict(free)}")

    def queue_segments(self, program: MotionProgram, first: int, last: int) -> None:
        """Send segments `first` to `last` (exclusive) of every axis and check every prompt."""
        lines = self._mode.lines(first, last)
        self._take_places(last - first)
        try:
            self._stream.pipeline(lines)
        except RejectedError as refusal:
            raise self._after_refusal(self._mode.place_of(refusal.index, first)) from refusal

    def queue_end(self) -> None:
        """Send the end marker to every axis."""
        self._take_places(1)
        try:
            self._stream.pipeline(self._mode.end_lines())
        except RejectedError as refusal:
            raise self._after_refusal("the end marker") from refusal

    def begin_segments(self) -> None:
        """Open the beam gate and start all axes in one packet, then read the gate back."""
        self._guard.beat_now()
        lines = [f"{self._gate.open_command}\r", f"{self._mode.begin()}\r"]
        try:
            self._stream.pipeline([line.encode("ascii") for line in lines])
        except RejectedError as refusal:
            raise self._after_refusal(repr(lines[refusal.index].strip())) from refusal
        except LinkError:
            self._gate.close()
            raise
        if not self._gate.is_open():
            raise ControllerError("the beam gate did not open", "check its output and wiring")

    def buffer_status(self) -> BufferStatus:
        """Poll counts and stop codes of all axes and the guard in one round trip, with a sign of life."""
        letters, counts = self._letters, self._mode.operands()
        codes = [f"_SC{letter}" for letter in letters]
        values = self._reader.numbers([*counts, *codes, THREAD_RUNS], after=self._guard.beat())
        executed, free = self._mode.counts(values[: len(counts)], self._queued)
        self._free = dict(zip(letters, free, strict=True))
        return BufferStatus(
            free_places=dict(self._free),
            executed_segments=dict(zip(letters, executed, strict=True)),
            stop_codes=dict(zip(letters, values[len(counts) : -1], strict=True)),
            guard_runs=values[-1] >= 0,
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

    def abort(self) -> None:
        """Close the gate and stop without deceleration; the bytes leave before anything is waited for."""
        lines = f"{self._gate.close_command}\rAB\r".encode("ascii")
        try:
            self._shout(lines)
        except LinkError:
            self._abort = self._open("abort")
            self._shout(lines)

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

    def _shout(self, lines: bytes) -> None:
        if self._handles.shared:
            self._abort.shout(b"\r" + lines)
            self._abort.abandon("an abort broke into it")
        else:
            self._abort.shout(lines)
            self._abort.heard(prompts=2)

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
