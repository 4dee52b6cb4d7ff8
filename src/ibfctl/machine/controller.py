"""The port: what the product asks of a motion controller, whoever makes it.

A driver package registers a factory under the entry point group ``ibfctl.drivers``; the factory
takes a `MachineDescription` and returns an object with the methods of `MotionController`.
"""

from __future__ import annotations

from collections.abc import Mapping
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
    guard_runs
        Whether the guard on the controller watches; it ends once it has had to act.
    """

    free_places: Mapping[str, int]
    executed_segments: Mapping[str, int]
    stop_codes: Mapping[str, int]
    guard_runs: bool


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

    def start_guard(self, patience_s: float) -> None:
        """Load the guard onto the controller, read it back and start it.

        While the gate is open, the guard closes it on the controller itself when the motion is over, and
        closes it and stops the axes on a limit, a position error, an empty buffer, a lost link, or when no
        `buffer_status` was asked for during `patience_s` seconds of the controller.
        """

    def stop_guard(self) -> None:
        """Halt the guard; only once the gate is closed and the axes stand."""

    def prepare_segments(self, program: MotionProgram) -> None:
        """Make all axes of the job ready for this kind of program, with empty buffers and at rest."""

    def queue_segments(self, program: MotionProgram, first: int, last: int) -> None:
        """Send segments `first` to `last` (exclusive) of every axis and check every prompt.

        There must be room for all of them by the last `buffer_status`. If one is refused, the gate is
        closed before the reason is asked for, because what the buffers hold is no longer the plan.
        """

    def queue_end(self) -> None:
        """Send the end marker to every axis."""

    def begin_segments(self) -> None:
        """Open the beam gate and start all axes of the job on the same sample, as one act.

        The gate is opened nowhere else. Both commands travel in one packet, so that the beam stands
        still for no round trip; the gate is read back, and closed again if the axes were not started.
        """

    def buffer_status(self) -> BufferStatus:
        """Poll what the streamer needs, in as few round trips as the protocol allows."""

    def status(self) -> Mapping[str, AxisStatus]:
        """Full status of every axis of the job, by axis letter."""

    def close_gate(self) -> None:
        """Switch the beam gate output to closed and read it back, from any thread.

        It has a handle of its own and tries fresh ones where that is dead.
        """

    def gate_is_open(self) -> bool:
        """Read the gate output back from the controller."""

    def stop(self) -> None:
        """Decelerate all axes of the job to rest (controlled stop)."""

    def abort(self) -> None:
        """Close the gate and stop all motion without deceleration, in this order, in one packet.

        Callable from any thread at any time: it has its own handle and waits for no lock and no queue.
        """

    def close(self) -> None:
        """Close all handles. Never raises."""
