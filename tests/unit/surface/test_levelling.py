"""Terms that are free, and the projection that takes them out."""

from __future__ import annotations

import numpy as np
import pytest

from ibfctl.errors import InputError
from ibfctl.surface.levelling import Levelling
from ibfctl.surface.terms import terms_of

Y, X = np.mgrid[0:40, 0:60].astype(float)
MASKS = {
    "rectangle": np.ones(X.shape, dtype=bool),
    "disc": np.hypot(X - 30, Y - 20) < 19,
    "U": ~((np.abs(X - 30) < 10) & (Y > 15)),
    "holes": np.random.default_rng(3).random(X.shape) < 0.6,
}


def power_series(degree: int) -> list[np.ndarray]:
    return [(X - 20) ** i * (Y - 30) ** (total - i) for total in range(degree + 1) for i in range(total + 1)]


@pytest.mark.parametrize("shape", MASKS)
@pytest.mark.parametrize(
    ("removed", "gone", "kept"),
    [
        ("none", [], [np.ones(X.shape)]),
        ("piston", power_series(0), [X, Y]),
        ("tilt", power_series(1), [X**2 + Y**2, X * Y]),
        ("power", [*power_series(1), X**2 + Y**2], [X * Y, X**2 - Y**2]),
        ("legendre:0", power_series(0), [X]),
        ("legendre:1", power_series(1), [X * Y]),
        ("legendre:4", power_series(4), [X**5, X**3 * Y**2]),
        ("legendre:8", power_series(8), [((X - 30) / 30) ** 9]),
        ("zernike:1", power_series(0), [X]),
        ("zernike:4", [*power_series(1), X**2 + Y**2], [X * Y]),
        ("zernike:6", power_series(2), [X**3]),
        ("zernike:15", power_series(4), [X**5]),
        ("zernike:45", power_series(8), [((Y - 20) / 20) ** 9]),
    ],
)
def test_what_is_free_is_gone_and_nothing_else(
    shape: str, removed: str, gone: list[np.ndarray], kept: list[np.ndarray]
) -> None:
    mask = MASKS[shape]
    levelling = Levelling.over(mask, removed)
    np.testing.assert_allclose(levelling.basis @ levelling.basis.T, np.eye(len(gone)), atol=1e-9)
    for form in gone:
        values = form[mask] / np.abs(form[mask]).max()
        assert np.abs(levelling(values)).max() < 1e-8
    for form in kept:
        values = form[mask] / np.abs(form[mask]).max()
        assert np.abs(levelling(values)).max() > 1e-4
    random = np.random.default_rng(1).normal(size=int(mask.sum()))
    np.testing.assert_allclose(levelling(levelling(random)), levelling(random), atol=1e-12)


def test_the_zernike_polynomials_are_those_of_noll() -> None:
    y, x = np.mgrid[-1:1:401j, -1:1:401j]
    inside = np.hypot(x, y) <= 1
    x, y = x[inside], y[inside]
    r2, angle = x**2 + y**2, np.arctan2(y, x)
    terms = terms_of("zernike:15", x, y)
    for index, value in {
        2: x,
        3: y,
        4: 2 * r2 - 1,
        5: r2 * np.sin(2 * angle),
        6: x**2 - y**2,
        7: (3 * r2 - 2) * y,
        8: (3 * r2 - 2) * x,
        9: r2**1.5 * np.sin(3 * angle),
        10: r2**1.5 * np.cos(3 * angle),
        11: 6 * r2**2 - 6 * r2 + 1,
        12: (4 * r2 - 3) * (x**2 - y**2),
        15: r2**2 * np.sin(4 * angle),
    }.items():
        np.testing.assert_allclose(terms[index - 1], value, atol=1e-12)
    # Orthogonal on the disc, but for its pixels.
    share = terms @ terms.T / np.sqrt(np.outer((terms**2).sum(axis=1), (terms**2).sum(axis=1)))
    assert np.abs(share - np.eye(15)).max() < 0.01


@pytest.mark.parametrize(
    "removed",
    ["", "tilts", "legendre", "legendre:", "legendre:9", "legendre:-1", "zernike:0", "zernike:46", "zernike:4.5"],
)
def test_what_names_no_terms_is_refused(removed: str) -> None:
    with pytest.raises(InputError, match="names none") as caught:
        Levelling.over(MASKS["disc"], removed)
    assert "--remove" in caught.value.hint


def test_one_line_of_pixels_has_no_tilt_across() -> None:
    mask = np.zeros((5, 9), dtype=bool)
    mask[2] = True
    assert Levelling.over(mask, "tilt").basis.shape == (2, 9)
    mask[2, 1:] = False
    assert Levelling.over(mask, "zernike:10").basis.shape == (1, 1)
