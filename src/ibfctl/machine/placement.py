"""How the part stands on the machine: mirrored or not, rotated, shifted; given, or fitted to fiducials."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ibfctl.errors import InputError

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

# Sines and cosines of right angles come out as they are.
_DECIMALS = 15


@dataclass(frozen=True)
class Placement:
    """Part coordinates to machine coordinates: x reversed where mirrored, then rotation, then offset.

    Attributes
    ----------
    offset_x_mm, offset_y_mm
        Where the part's origin lies on the machine.
    rotation_deg
        From the part's x axis (after mirroring) to the machine's, counterclockwise.
    mirrored
        Whether x counts the other way on the part, as on one that is measured from its back.
    fiducial_rms_mm, fiducial_max_mm
        How far the fiducials lie from where the placement puts them; None where it was given, not fitted.
    """

    offset_x_mm: float = 0.0
    offset_y_mm: float = 0.0
    rotation_deg: float = 0.0
    mirrored: bool = False
    fiducial_rms_mm: float | None = None
    fiducial_max_mm: float | None = None

    def __post_init__(self) -> None:
        if not np.isfinite([self.offset_x_mm, self.offset_y_mm, self.rotation_deg]).all():
            raise InputError("placement: offset or rotation is no finite number", "correct --offset-mm, --rotation-deg")

    @property
    def as_mounted(self) -> bool:
        """Whether part and machine coordinates are the same."""
        return not (self.offset_x_mm or self.offset_y_mm or self.turned)

    @property
    def turned(self) -> bool:
        """Whether directions differ between part and machine."""
        return self.mirrored or self.rotation_deg != 0.0

    @property
    def matrix(self) -> FloatArray:
        """Directions on the machine, (2, 2), from directions on the part."""
        angle = np.radians(self.rotation_deg)
        cosine, sine = np.round([np.cos(angle), np.sin(angle)], _DECIMALS)
        across = -1.0 if self.mirrored else 1.0
        return np.array([[across * cosine, -sine], [across * sine, cosine]])

    def __call__(self, x_mm: FloatArray, y_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Machine coordinates of positions on the part."""
        if self.as_mounted:
            return x_mm, y_mm
        (xx, xy), (yx, yy) = self.matrix
        return xx * x_mm + xy * y_mm + self.offset_x_mm, yx * x_mm + yy * y_mm + self.offset_y_mm

    def inverse(self, x_mm: FloatArray, y_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Part coordinates of positions on the machine."""
        if self.as_mounted:
            return x_mm, y_mm
        (xx, xy), (yx, yy) = self.matrix
        x_mm, y_mm = x_mm - self.offset_x_mm, y_mm - self.offset_y_mm
        return xx * x_mm + yx * y_mm, xy * x_mm + yy * y_mm


AS_MOUNTED = Placement()


def fit_placement(
    part_mm: FloatArray, machine_mm: FloatArray, *, mirrored: bool = False, limit_mm: float = 0.05
) -> Placement:
    """Fit a placement to pairs of positions, by least squares.

    Parameters
    ----------
    part_mm, machine_mm : (n, 2) float64
        The same fiducials on the part and on the machine; two or more.
    mirrored
        Whether the part is mirrored: two fiducials cannot tell.
    limit_mm
        How far a fiducial may lie from where the placement puts it.

    Raises
    ------
    InputError
        If the fiducials do not fix a placement, or one is off by more than the limit.
    """
    if part_mm.shape != machine_mm.shape or part_mm.ndim != 2 or part_mm.shape[0] < 2:
        raise InputError("fiducials: fewer than two pairs", "give two fiducials or more, far apart")
    part, machine = (points[:, 0] + 1j * points[:, 1] for points in (part_mm, machine_mm))
    if not (np.isfinite(part).all() and np.isfinite(machine).all()):
        raise InputError("fiducials: a position is no finite number", "correct the file")
    if np.abs(part - part.mean()).max() <= limit_mm or np.abs(machine - machine.mean()).max() <= limit_mm:
        raise InputError("fiducials: all lie at one place", "give fiducials that are far apart")
    placement, error_mm = _fitted(part, machine, mirrored)
    if error_mm.max() > limit_mm:
        worst = int(np.argmax(error_mm))
        other = _fitted(part, machine, not mirrored)[1].max() <= limit_mm
        raise InputError(
            f"fiducials: number {worst + 1} is {error_mm[worst]:.3g} mm from where the fit of all puts it, "
            f"the limit is {limit_mm:g} mm",
            f"the part is {'not ' if mirrored else ''}mirrored: correct --mirror"
            if other
            else "check the pairs and their units, measure again, or raise --fiducial-limit-mm",
        )
    return placement


def _fitted(part: ComplexArray, machine: ComplexArray, mirrored: bool) -> tuple[Placement, FloatArray]:
    """Best placement of positions as complex numbers, and what is left of each."""
    seen = -part.conj() if mirrored else part
    correlation = np.vdot(seen - seen.mean(), machine - machine.mean())
    turn = correlation / abs(correlation) if correlation else 1.0 + 0j
    offset = machine.mean() - turn * seen.mean()
    error_mm = np.abs(turn * seen + offset - machine)
    rms_mm, max_mm = float(np.sqrt(np.mean(error_mm**2))), float(error_mm.max())
    rotation_deg = float(np.degrees(np.angle(turn)))
    return Placement(float(offset.real), float(offset.imag), rotation_deg, mirrored, rms_mm, max_mm), error_mm
