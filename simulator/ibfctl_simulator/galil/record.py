"""The data record: a fixed little-endian picture of the controller, asked by `QR` or pushed by `DR`."""

from __future__ import annotations

import struct

from ibfctl_simulator.galil.axis import Axis
from ibfctl_simulator.galil.handles import LETTERS, Handles
from ibfctl_simulator.galil.profiles import PhasedProfile
from ibfctl_simulator.galil.programs.engine import Engine
from ibfctl_simulator.galil.servo import FULL_TORQUE_VOLTS
from ibfctl_simulator.galil.state import State

HEADER = struct.Struct("<BBH")
GENERAL_BYTES = 78
AXIS = struct.Struct("<HBBiiiiiiHBBi")
GENERAL_PRESENT = 0x87  # header valid; S, T and general blocks present
TORQUE_UNITS_PER_VOLT = 3255
TCP_SLAVE = 2


def encode(state: State, handles: Handles, engine: Engine) -> bytes:
    """Return the record of the present sample: 82 bytes and 36 for each axis."""
    axes = len(state.axes)
    length = HEADER.size + GENERAL_BYTES + AXIS.size * axes
    general = struct.pack(
        "<H10s10s16x8sBB4xIH20x",
        state.time & 0xFFFF,
        state.inputs.to_bytes(10, "little"),
        state.outputs.to_bytes(10, "little"),
        bytes(TCP_SLAVE if handles.get(letter) else 0 for letter in LETTERS),
        state.error_code,
        sum(1 << thread.number for thread in engine.running),
        state.contour.executed & 0xFFFFFFFF,
        state.contour.free,
    )
    header = HEADER.pack(GENERAL_PRESENT, (1 << axes) - 1, length)
    return header + general + b"".join(_axis(axis, state.analog_inputs[i]) for i, axis in enumerate(state.axes))


def _axis(axis: Axis, analog_volts: float) -> bytes:
    return AXIS.pack(
        status_word(axis),
        switch_byte(axis),
        axis.stop_code,
        _signed(axis.reference_counts),
        _signed(axis.encoder_counts),
        _signed(axis.error_counts),
        _signed(axis.dual_counts),
        _signed(round(axis.velocity_counts_s * 64)),
        round(min(axis.servo.torque_volts, FULL_TORQUE_VOLTS) * TORQUE_UNITS_PER_VOLT),
        round(analog_volts / 10.0 * 0x7FFF) & 0xFFFF,
        0,
        0,
        _signed(round(axis.parameters["ZA"])),
    )


def status_word(axis: Axis) -> int:
    """Return the 16 status bits of an axis."""
    profile = axis.profile
    phased = profile if isinstance(profile, PhasedProfile) else None
    bits = {
        15: axis.moving,
        14: axis.mode in ("absolute", "relative"),
        13: axis.mode == "absolute",
        12: axis.mode == "edge",
        11: axis.mode == "home",
        10: axis.mode == "home" and axis.home_phase >= 1,
        9: axis.mode == "index" or (axis.mode == "home" and axis.home_phase == 2),
        7: axis.velocity_counts_s < 0.0,
        6: axis.mode == "contour",
        5: phased is not None and phased.slewing,
        4: axis.stopping,
        3: phased is not None and phased.braking,
        1: axis.parameters["OE"] > 0,
        0: not axis.motor_on,
    }
    return sum(1 << bit for bit, on in bits.items() if on)


def switch_byte(axis: Axis) -> int:
    """Return the switch bits of an axis; a limit bit is 1 while its switch is inactive."""
    bits = {
        0: abs(axis.parameters["MT"]) >= 2,
        1: axis.switches.home_at(axis.physical_counts),
        2: not axis.limit_active("reverse"),
        3: not axis.limit_active("forward"),
    }
    return sum(1 << bit for bit, on in bits.items() if on)


class RecordPusher:
    """`DR n, h`: sends the record to a handle every n samples, without a prompt."""

    def __init__(self) -> None:
        self.period_samples = 0
        self._letter = ""
        self._due = 0

    def start(self, period_samples: int, letter: str, sample: int) -> None:
        """Push every `period_samples` samples from `sample` on; 0 ends it."""
        self.period_samples, self._letter, self._due = period_samples, letter, sample + period_samples

    def samples_left(self, sample: int) -> int | None:
        """Samples until the next record; None if none is due."""
        return max(1, self._due - sample) if self.period_samples else None

    def push(self, state: State, handles: Handles, engine: Engine) -> None:
        """Send a record if one is due; a handle that is closed gets no more."""
        if not self.period_samples or state.sample < self._due:
            return
        handle = handles.get(self._letter)
        if handle is None:
            self.period_samples = 0
            return
        handle.send(encode(state, handles, engine))
        self._due += self.period_samples


def _signed(value: int) -> int:
    """Wrap to 32 bits, as the controller's registers do."""
    return (value + (1 << 31)) % (1 << 32) - (1 << 31)
