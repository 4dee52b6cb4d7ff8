"""Terms of a surface's form that may be free: piston, tilt, power, Legendre and Zernike polynomials.

``legendre:N`` are the products P_i(x) P_j(y) with i + j <= N, ``zernike:N`` the first N Zernike polynomials in Noll's
order (J. Opt. Soc. Am. 66, 207, 1976). Every set holds all polynomials of the degrees below its highest, so that what
it spans depends neither on the origin nor on the scale: any rectangle or circle around the aperture does.
"""

from __future__ import annotations

import math
import re

import numpy as np
from numpy.polynomial.legendre import legvander
from numpy.typing import NDArray

from ibfctl.errors import InputError

FloatArray = NDArray[np.float64]
Removed = str
"""none, piston, tilt (with piston), power (with tilt), legendre:N (N to 8) or zernike:N (N to 45)."""

MAX_DEGREE = 8
MAX_TERMS = 45
_NAMED = {"none": 0, "piston": 1, "tilt": 3, "power": 4}
_NUMBERED = re.compile(r"(legendre|zernike):(\d{1,2})")


def check_terms(removed: Removed) -> None:
    """Refuse what names no terms.

    Raises
    ------
    InputError
        With all that is allowed.
    """
    numbered = _NUMBERED.fullmatch(removed)
    if numbered:
        kind, number = numbered[1], int(numbered[2])
        allowed = number <= MAX_DEGREE if kind == "legendre" else 1 <= number <= MAX_TERMS
    if not (allowed if numbered else removed in _NAMED):
        raise InputError(
            f"removed terms: {removed!r} names none",
            f"give --remove none, piston, tilt, power, legendre:N (N to {MAX_DEGREE}) or zernike:N (1 to {MAX_TERMS})",
        )


def terms_of(removed: Removed, x: FloatArray, y: FloatArray) -> FloatArray:
    """Values (k, m) of the terms at positions x, y (m,), the piston first; of any scale and origin.

    Raises
    ------
    InputError
        If `removed` names no terms.
    """
    check_terms(removed)
    x, y = x - 0.5 * (x.min() + x.max()), y - 0.5 * (y.min() + y.max())
    kind, _, number = removed.partition(":")
    if kind == "legendre":
        return _legendre(int(number), *(part / max(float(np.abs(part).max()), 1e-300) for part in (x, y)))
    radius = max(float(np.hypot(x, y).max()), 1e-300)
    x, y = x / radius, y / radius
    if kind in _NAMED:
        return np.stack([np.ones(x.size), x, y, x**2 + y**2])[: _NAMED[kind]]
    return _zernike(int(number), x, y)


def _legendre(degree: int, x: FloatArray, y: FloatArray) -> FloatArray:
    along_x, along_y = legvander(x, degree).T, legvander(y, degree).T
    return np.stack([along_x[total - j] * along_y[j] for total in range(degree + 1) for j in range(total + 1)])


def _zernike(number: int, x: FloatArray, y: FloatArray) -> FloatArray:
    radius, angle = np.hypot(x, y), np.arctan2(y, x)
    terms = np.empty((number, x.size))
    for index in range(1, number + 1):
        degree, order = _noll(index)
        radial = sum(
            (-1) ** k
            * math.factorial(degree - k)
            / math.prod(map(math.factorial, (k, (degree + order) // 2 - k, (degree - order) // 2 - k)))
            * radius ** (degree - 2 * k)
            for k in range((degree - order) // 2 + 1)
        )
        terms[index - 1] = radial * (np.sin(order * angle) if index % 2 and order else np.cos(order * angle))
    return terms


def _noll(index: int) -> tuple[int, int]:
    """Radial degree and azimuthal order of a Zernike polynomial, counted from 1 in Noll's order; odd ones are sines."""
    degree = math.ceil((math.sqrt(8 * index + 1) - 3) / 2 - 1e-9)
    place = index - degree * (degree + 1) // 2
    order = 2 * (place // 2) if degree % 2 == 0 else 2 * ((place - 1) // 2) + 1
    return degree, order
