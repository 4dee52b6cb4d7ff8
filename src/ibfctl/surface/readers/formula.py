"""Influence functions given as a formula: `gaussian:fwhm_mm=..,peak_nm_s=..,radius_mm=..`."""

from __future__ import annotations

from ibfctl.errors import InputError
from ibfctl.surface.influence import InfluenceFunction, gaussian
from ibfctl.surface.readers.quantity import MAX_PIXELS

GAUSSIAN_PREFIX = "gaussian:"
_KEYS = ("fwhm_mm", "peak_nm_s", "radius_mm")
_PIXELS_PER_RADIUS = 50


def read_gaussian(spec: str, pixel_mm: float | None) -> InfluenceFunction:
    """Make the influence function of a formula, sampled at `pixel_mm` or at 1/50 of its radius."""
    values: dict[str, float] = {}
    for part in spec.removeprefix(GAUSSIAN_PREFIX).split(","):
        key, _, text = part.partition("=")
        if key.strip() not in _KEYS or key.strip() in values:
            raise InputError(f"influence function {spec}: {key.strip()!r} is not expected here", _hint())
        try:
            values[key.strip()] = float(text)
        except ValueError as error:
            raise InputError(f"influence function {spec}: {key.strip()} is no number", _hint()) from error
    missing = [key for key in _KEYS if key not in values]
    if missing:
        raise InputError(f"influence function {spec}: {', '.join(missing)} missing", _hint())
    radius_mm = values["radius_mm"]
    if pixel_mm is not None and not (pixel_mm > 0 and (2 * radius_mm / pixel_mm + 3) ** 2 <= MAX_PIXELS):
        raise InputError(
            f"influence function {spec}: pixel size {pixel_mm:g} mm does not suit its radius",
            "give a larger pixel size, or none",
        )
    return gaussian(
        values["fwhm_mm"],
        values["peak_nm_s"],
        radius_mm,
        pixel_mm if pixel_mm is not None else radius_mm / _PIXELS_PER_RADIUS,
    )


def _hint() -> str:
    return "write " + GAUSSIAN_PREFIX + ",".join(f"{key}=NUMBER" for key in _KEYS)
