"""The port: what the product asks of a motion controller, whoever makes it.

A driver package registers a factory under the entry point group ``ibfctl.drivers``; the factory
takes a `MachineDescription` and returns an object with the methods of `MotionController`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from ibfctl.machine.program import PvtProgram


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
        The controller's reason for the present state: 30 PVT running, 31 PVT complete, 32 buffer ran empty.
    moving, motor_on
        True while a profile is being generated; True while the servo holds.
    free_places, executed_segments
        Free places of the PVT buffer and segments executed since begin (the end marker counts as one).
    """

    position_counts: int
    error_counts: int
    stop_code: int
    moving: bool
    motor_on: bool
    free_places: int
    executed_segments: int


@dataclass(frozen=True)
class BufferStatus:
    """The cheap poll while streaming, per axis letter: free places, executed segments, stop code."""

    free_places: Mapping[str, int]
    executed_segments: Mapping[str, int]
    stop_codes: Mapping[str, int]


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

    def clear_segments(self) -> None:
        """Empty the PVT buffers of all axes of the job."""

    def queue_segments(self, program: PvtProgram, first: int, last: int) -> None:
        """Send segments `first` to `last` (exclusive) of every axis and check every prompt."""

    def queue_end(self) -> None:
        """Send the end marker to every axis."""

    def begin_segments(self) -> None:
        """Start all axes of the job on the same sample."""

    def buffer_status(self) -> BufferStatus:
        """Poll what the streamer needs, in as few round trips as the protocol allows."""

    def status(self) -> Mapping[str, AxisStatus]:
        """Full status of every axis of the job, by axis letter."""

    def open_gate(self) -> None:
        """Switch the beam gate output to open and verify it by reading it back."""

    def close_gate(self) -> None:
        """Switch the beam gate output to closed; tries a fresh handle where the usual one is dead."""

    def gate_is_open(self) -> bool:
        """Read the gate output back from the controller."""

    def stop(self) -> None:
        """Decelerate all axes of the job to rest (controlled stop)."""

    def abort(self) -> None:
        """Stop all motion without deceleration, on its own handle, callable from any thread at any time."""

    def close(self) -> None:
        """Close all handles. Never raises."""
