"""Motion outside a program: servo on, to a position and no further, to rest."""

from __future__ import annotations

import time
from collections.abc import Mapping

from ibfctl.errors import ControllerError
from ibfctl.machine.description import Axis, MachineDescription
from ibfctl_drivers.galil.axes import AxisReader
from ibfctl_drivers.galil.codec import acceleration, speed
from ibfctl_drivers.galil.link import Link

POLL_S = 0.005
STOPPED_AT_TARGET, HOMED = 1, 10


class Approach:
    """Moves the axes of a machine one position at a time.

    Parameters
    ----------
    machine
        Gives scales, speeds, tolerance and patience.
    link
        Handle for commands.
    reader
        Asks where the axes are.
    """

    def __init__(self, machine: MachineDescription, link: Link, reader: AxisReader) -> None:
        self._servo = machine.servo
        self._homing = machine.homing
        self._axes: dict[str, Axis] = dict(machine.axes.items())
        self._letters = "".join(sorted(machine.axes))
        self._link = link
        self._reader = reader

    def servo_on(self) -> None:
        """Set the error limit and what follows from it, then switch the servos on."""
        for letter in self._letters:
            self._link.tell(f"ER{letter}={self._servo.error_limit_counts}")
            self._link.tell(f"OE{letter}={self._servo.off_on_error}")
        self._link.tell(f"SH {self._letters}")
        if any(self._reader.numbers(f"_MO{letter}" for letter in self._letters)):
            raise ControllerError("a motor stays off after SH", "check amplifier enable and the abort input")

    def servo_off(self) -> None:
        """Switch the servos off."""
        self._link.tell(f"MO {self._letters}")

    def move_to(self, position_counts: Mapping[str, int]) -> None:
        """Move at approach speed and wait; a later stop decelerates at the axes' own limit."""
        for letter, target in position_counts.items():
            scale = self._axes[letter].counts_per_mm
            ramp = acceleration(self._servo.approach_acceleration_mm_s2 * scale)
            self._link.tell(f"AC{letter}={ramp}")
            self._link.tell(f"DC{letter}={ramp}")
            self._link.tell(f"SP{letter}={speed(self._servo.approach_speed_mm_s * scale)}")
            self._link.tell(f"PA{letter}={target}")
        self._link.tell(f"BG {''.join(position_counts)}")
        self._await(position_counts)
        for letter in position_counts:
            axis = self._axes[letter]
            self._link.tell(f"DC{letter}={acceleration(axis.a_max_mm_s2 * axis.counts_per_mm)}")

    def home(self) -> None:
        """Find the home place of every axis, call it by its position, and remember that on the controller.

        The controller loses the variable `homedA` with its power, as it loses where the axis is.
        """
        if self._homing.method == "absolute":
            return
        for letter in self._letters:
            axis = self._axes[letter]
            scale = axis.counts_per_mm
            self._link.tell(f"homed{letter}=0")
            for name in ("AC", "DC"):
                self._link.tell(f"{name}{letter}={acceleration(self._servo.approach_acceleration_mm_s2 * scale)}")
            for name, speed_mm_s in (("SP", self._homing.speed_mm_s), ("HV", self._homing.creep_mm_s)):
                self._link.tell(f"{name}{letter}={speed(speed_mm_s * scale)}")
            self._link.tell(f"JG{letter}={speed(self._homing.creep_mm_s * scale)}")
            self._link.tell(f"{'FI' if self._homing.method == 'index' else 'HM'} {letter}")
            self._link.tell(f"BG {letter}")
            deadline = time.monotonic() + self._servo.settle_timeout_s
            while self._reader.status(letter).moving:
                self._pause(deadline, f"find the home place of {letter}")
            code = self._reader.status(letter).stop_code
            if code != HOMED:
                raise ControllerError(
                    f"axis {letter} stopped with code {code} before it found its home place",
                    "check the home switch and the encoder's index, and the machine file's [homing]",
                )
            self._link.tell(f"DP{letter}={round(axis.home_mm * axis.signed_counts_per_mm)}")
            self._link.tell(f"homed{letter}=1")

    def homed(self) -> dict[str, bool]:
        """Whether each axis was homed since the controller has had power."""
        if self._homing.method == "absolute":
            return dict.fromkeys(self._letters, True)
        return {letter: self._reader.variable(f"homed{letter}") == 1 for letter in self._letters}

    def stop(self) -> None:
        """Decelerate and wait until all axes stand."""
        self._link.tell(f"ST {self._letters}")
        deadline = time.monotonic() + self._servo.settle_timeout_s
        while any(self._reader.numbers(f"_BG{letter}" for letter in self._letters)):
            self._pause(deadline, "stop")

    def _await(self, position_counts: Mapping[str, int]) -> None:
        deadline = time.monotonic() + self._servo.settle_timeout_s
        while not self._has_arrived(position_counts):
            self._pause(deadline, f"reach {dict(position_counts)} counts")

    def _has_arrived(self, position_counts: Mapping[str, int]) -> bool:
        axes = {letter: self._reader.status(letter) for letter in position_counts}
        if any(axis.moving for axis in axes.values()):
            return False
        for letter, axis in axes.items():
            if axis.stop_code != STOPPED_AT_TARGET or not axis.motor_on:
                raise ControllerError(
                    f"axis {letter} stopped with code {axis.stop_code} before it reached "
                    f"{position_counts[letter]} counts",
                    "check limit switches, amplifier and position error",
                )
        errors = (axes[letter].position_counts - target for letter, target in position_counts.items())
        return all(abs(error) <= self._servo.position_tolerance_counts for error in errors)

    def _pause(self, deadline: float, what: str) -> None:
        if time.monotonic() > deadline:
            raise ControllerError(
                f"axes did not {what} within {self._servo.settle_timeout_s:g} s",
                "check limits, amplifiers and servo tuning; settle_timeout_s is in the machine file",
            )
        time.sleep(POLL_S)
