"""What may differ between controllers: the model, and every point that no source confirms."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from ibfctl_simulator.galil.servo import ServoModel
from ibfctl_simulator.galil.switches import SwitchPlaces

SAMPLES_PER_SECOND = 1024
"""Samples per second at the default TM 1000."""


@dataclass(frozen=True)
class Settings:
    """One emulated controller.

    Attributes
    ----------
    family, axes, firmware
        Model family, number of axes (1 to 8) and firmware revision, as `^R^V` reports them.
    pvt_places
        Places of the PVT buffer of one axis.
    pvt_full_error
        Error code of a `PV` at a full buffer; 0 drops the segment without an error. Unconfirmed.
    pvt_minimum_samples, pvt_even_samples
        Shortest segment, and whether an odd time is refused. Unconfirmed.
    begin_empty_error
        Error code of a `BT` on an axis without segments; 0 accepts it. Unconfirmed.
    begin_motor_off_error, begin_running_error
        Error codes of a `BT` with the motor off and of a second `BT`. Unconfirmed for PVT.
    underrun_deceleration
        How an axis stops when its buffer ran empty: with DC or at once. Unconfirmed.
    continue_line_after_error
        Whether the commands after a rejected one on the same line still run. Unconfirmed.
    contour_places
        Places of the contour buffer that all axes share; smaller models may have 31. Unconfirmed for them.
    line_characters
        Longest command line, all parts between `;` included.
    overlong_error
        Error code of an over-long line. Unconfirmed.
    missing_axis_error
        Error code of an axis that the model does not have. Unconfirmed.
    message_leading_blank
        Whether `MG` puts a blank in the place of the sign of a positive value. Unconfirmed.
    latch_orderly_close
        Whether a client that closes in good order also latches error 123. Unconfirmed.
    motor_on_at_start
        Whether the servos hold after power-up. Unconfirmed.
    idle_inputs
        Level of an input that nothing drives. Unconfirmed.
    commands_per_sample
        Commands that all program threads together carry out in one sample. Unconfirmed.
    burn_s
        How long `BP` keeps the controller from answering, in s.
    reset_keeps_connections
        Whether TCP connections survive `RS`. Unconfirmed.
    servo, switches
        How each axis follows its command, and where its switches are.
    """

    family: Literal["40x0", "41x3"] = "40x0"
    axes: int = 2
    firmware: str = "1.3a"
    serial_number: int = 4020
    pvt_places: int = 255
    pvt_full_error: int = 32
    pvt_minimum_samples: int = 1
    pvt_even_samples: bool = False
    begin_empty_error: int = 24
    begin_motor_off_error: int = 20
    begin_running_error: int = 21
    underrun_deceleration: Literal["DC", "instant"] = "DC"
    continue_line_after_error: bool = True
    contour_places: int = 511
    line_characters: int = 80
    overlong_error: int = 5
    missing_axis_error: int = 4
    message_leading_blank: bool = True
    latch_orderly_close: bool = False
    motor_on_at_start: bool = False
    idle_inputs: Literal[0, 1] = 1
    commands_per_sample: int = 20
    burn_s: float = 2.0
    reset_keeps_connections: bool = False
    servo: ServoModel = field(default_factory=ServoModel)
    switches: SwitchPlaces = field(default_factory=SwitchPlaces)

    def __post_init__(self) -> None:
        if not 1 <= self.axes <= 8:
            raise ValueError(f"axes: {self.axes} is not between 1 and 8")
        if self.family not in ("40x0", "41x3"):
            raise ValueError(f"family: {self.family!r} is neither '40x0' nor '41x3'")
        if self.underrun_deceleration not in ("DC", "instant"):
            raise ValueError(f"underrun_deceleration: {self.underrun_deceleration!r} is neither 'DC' nor 'instant'")

    @property
    def model(self) -> str:
        """Model name with the number of axes at its usual place, e.g. `DMC4020` or `DMC4123`."""
        return f"DMC40{self.axes}0" if self.family == "40x0" else f"DMC41{self.axes}3"

    @property
    def identity(self) -> str:
        """Answer to `^R^V`."""
        return f"{self.model} Rev {self.firmware}"
