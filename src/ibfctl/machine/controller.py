"""The port: what the product asks of a motion controller, whoever makes it.

A driver package registers a factory under the entry point group ``ibfctl.drivers``; the factory
takes a `MachineDescription` and returns an object with the methods of `MotionController`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from ibfctl.machine.program import MotionProgram


@dataclass(frozen=True)
class ControllerIdentity:
    """Who answers: model text with firmware revision, and the number of axes."""

    model: str
    axes: int


@dataclass(frozen=True)
class AxisStatus:
    """One axis as the controller reports it.

    Attributes
    ----------
    position_counts, error_counts
        Encoder position and following error (commanded minus encoder).
    stop_code
        The controller's reason for the present state: 30 PVT running, 31 PVT complete, 32 buffer ran empty,
        50 and 51 the same as 30 and 31 for contours.
    moving, motor_on
        True while a profile is being generated; True while the servo holds.
    """

    position_counts: int
    error_counts: int
    stop_code: int
    moving: bool
    motor_on: bool


@dataclass(frozen=True)
class BufferStatus:
    """The cheap poll while streaming.

    Attributes
    ----------
    free_places, executed_segments, stop_codes
        Per axis letter: free places of the segment buffer, segments executed since begin (the end marker
        counts as one), and the stop code as in `AxisStatus`.
    guard_runs, guard_reason
        Whether the guard on the controller watches; it ends once it has had to act, and why that was.
    time_samples, position_counts
        The controller's sample counter, and the encoder position per axis letter, of nearly the same moment.
    gate_open
        Whether the gate output reads open.
    """

    free_places: Mapping[str, int]
    executed_segments: Mapping[str, int]
    stop_codes: Mapping[str, int]
    guard_runs: bool
    guard_reason: str
    time_samples: int
    position_counts: Mapping[str, int]
    gate_open: bool


@dataclass(frozen=True)
class Stamps:
    """What the controller noted of one motion, on its own sample counter; None where it noted nothing.

    Attributes
    ----------
    begun
        When the axes began; the motion's first sample is the one after.
    opened, closed
        When the gate opened, and when it was first closed after that, whoever closed it.
    now
        When this was read.
    """

    begun: int | None
    opened: int | None
    closed: int | None
    now: int


class Observer(Protocol):
    """Is told of everything on the wire, in the thread in which it happens; it must neither block nor raise."""

    def __call__(self, handle: str, sent: str, reply: str, at_s: float) -> None:
        """Note one exchange.

        Parameters
        ----------
        handle
            What the handle is for.
        sent, reply
            Text of both; a batch of segments is told as its number of lines, first and last line, and a digest.
        at_s
            Monotonic time of the reply.
        """


class MotionController(Protocol):
    """A connected controller. Every call has a timeout and raises `ControllerError` (or `LinkError`).

    After a `LinkError` the object is closed and useless; `abort` and `close_gate` still try their own handle.
    """

    buffer_places: int

    def identify(self) -> ControllerIdentity:
        """Ask who answers."""

    def measure_sample_period_s(self, duration_s: float) -> float:
        """Compare the controller's sample counter with the host's monotonic clock over `duration_s`."""

    def servo_on(self) -> None:
        """Switch the servos of the job's axes on; they hold where they stand."""

    def servo_off(self) -> None:
        """Switch the servos of the job's axes off."""

    def move_to(self, position_counts: Mapping[str, int]) -> None:
        """Move the named axes to absolute positions and wait until they stand there within tolerance."""

    def home(self) -> None:
        """Find the home place of every axis and call it by its position from the machine file.

        That it was found is kept on the controller, which forgets it without power, as it forgets where it is.
        """

    def homed(self) -> Mapping[str, bool]:
        """Whether each axis knows where it is since the controller has had power."""

    def latched(self) -> bool:
        """Whether an emergency stop is latched on the controller; then nothing moves."""

    def soft_limits(self) -> Mapping[str, tuple[int, int]]:
        """Least and greatest position, in counts, that the controller lets each axis reach."""

    def read_inputs(self, digital: Sequence[int], analog: Sequence[int]) -> tuple[list[int], list[float]]:
        """Read levels of digital inputs and volts of analog ones, in one round trip."""

    def guard_owner_age_s(self) -> float | None:
        """Controller seconds since anybody last gave a running guard a sign of life; None where none runs."""

    def start_guard(self, patience_s: float) -> None:
        """Load the guard onto the controller, read it back and start it.

        While the gate is open, the guard closes it on the controller itself when the motion is over, and
        closes it and stops the axes on a limit, a position error, a lost link, a buffer that is about to be empty
        without an end marker, or when it heard no `sign_of_life` during `patience_s` seconds of the controller.
        """

    def sign_of_life(self) -> bool:
        """Tell the guard that the host lives, and return whether it runs.

        From a thread of its own: it waits for no segments and no polls.
        """

    def limit_replies(self, timeout_s: float | None) -> None:
        """Wait no longer for any reply to segments and questions, in seconds of the host; None as long as usual."""

    def check_stream(self) -> None:
        """See that the way that segments take is open, while there is none to send."""

    def stop_guard(self) -> None:
        """Halt the guard; only once the gate is closed and the axes stand."""

    def prepare_segments(self, program: MotionProgram) -> None:
        """Make all axes of the job ready for this kind of program, with empty buffers, at rest and without stamps."""

    def queue_segments(self, program: MotionProgram, first: int, last: int) -> None:
        """Send segments `first` to `last` (exclusive) of every axis and check every prompt.

        `program` may differ from the one prepared in what has not been sent. There must be room for all of them by
        the last `buffer_status`. If one is refused, the gate is
        closed before the reason is asked for, because what the buffers hold is no longer the plan.
        """

    def queue_end(self) -> None:
        """Send the end marker to every axis."""

    def begin_segments(self, open_at: int, close_at: int) -> None:
        """Start all axes of the job on the same sample, and stamp it.

        Parameters
        ----------
        open_at
            When so many segments are over the controller opens the beam gate by itself and stamps that. At 0 the
            gate opens as one act with the begin: both commands travel in one packet, so that the beam stands still
            for no round trip; it is read back, and closed again if the axes were not started. The gate is opened
            nowhere else.
        close_at
            When so many segments are over the controller closes the gate by itself and stamps that.
        """

    def set_close_at(self, segment: int) -> None:
        """Have the controller close the gate when so many segments are over; they must not be over yet."""

    def stamps(self) -> Stamps:
        """Read what the controller noted of the present or the last motion, over whichever handle still answers."""

    def buffer_status(self) -> BufferStatus:
        """Poll what the streamer needs, in as few round trips as the protocol allows."""

    def status(self) -> Mapping[str, AxisStatus]:
        """Full status of every axis of the job, by axis letter."""

    def close_gate(self) -> None:
        """Switch the beam gate output to closed, stamp that, and read it back, from any thread.

        Whatever on the controller was to open it later, no longer does. It has a handle of its own and tries fresh
        ones where that is dead.
        """

    def gate_is_open(self) -> bool:
        """Read the gate output back from the controller."""

    def stop(self) -> None:
        """Decelerate all axes of the job to rest (controlled stop)."""

    def halt(self) -> None:
        """Close the gate, read it back, and then have all axes decelerate, from any thread.

        It uses the gate's handle, waits for no other, and does not wait until the axes stand.
        """

    def estop(self) -> None:
        """Abort, switch the motors off, and latch that on the controller until it loses its power.

        Callable as `abort`. No software takes the latch back.
        """

    def abort(self) -> None:
        """Close the gate and stop all motion without deceleration, in this order, in one packet.

        Callable from any thread at any time: it has its own handle and waits for no lock and no queue.
        """

    def close(self) -> None:
        """Close all handles. Never raises."""
