"""Dot-product tests: every operator and its adjoint are one linear map; levelling is a projection."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from ibfctl.dwell.deposition import Grid
from ibfctl.dwell.misfit import make_misfit
from ibfctl.dwell.operator import Convolution, RemovalOperator
from ibfctl.surface.influence import InfluenceFunction
from ibfctl.surface.levelling import Levelling
from ibfctl.surface.map import SurfaceMap

RELATIVE = 1e-12
SEEDS = st.integers(0, 1_000_000)


def same(one: float, other: float, *vectors: np.ndarray) -> bool:
    """Equal but for rounding, by the size of what was multiplied."""
    return abs(one - other) <= RELATIVE * float(np.prod([np.linalg.norm(vector) for vector in vectors]))


def grids(draw: st.DrawFn) -> tuple[Grid, Grid]:
    """A map's grid and a source grid in line with it, overlapping, inside, around or far apart."""
    pixel_mm = draw(st.sampled_from([0.1, 0.25, 1.0]))
    target = Grid(draw(st.integers(2, 30)), draw(st.integers(2, 30)), pixel_mm, -1.3, 2.7)
    rows, columns = draw(st.integers(-40, 40)), draw(st.integers(-40, 40))
    return target, Grid(
        draw(st.integers(1, 40)),
        draw(st.integers(1, 40)),
        pixel_mm,
        target.x0_mm + columns * pixel_mm,
        target.y0_mm + rows * pixel_mm,
    )


@st.composite
def convolutions(draw: st.DrawFn) -> tuple[Convolution, Grid, Grid, InfluenceFunction, np.random.Generator]:
    target, source = grids(draw)
    random = np.random.default_rng(draw(SEEDS))
    shape = 2 * random.integers(1, 10, size=2) + 1
    influence = InfluenceFunction(random.normal(size=shape) ** 2 + 0.1, target.pixel_mm)
    return Convolution(target, source, influence), target, source, influence, random


@given(convolutions())
def test_convolution(case):
    convolution, target, source, influence, random = case
    time_s, values = random.normal(size=(source.ny, source.nx)), random.normal(size=(target.ny, target.nx))
    forward, backward = convolution(time_s), convolution.adjoint(values)
    assert forward.shape == values.shape
    assert backward.shape == time_s.shape
    assert same(
        float((forward * values).sum()), float((time_s * backward).sum()), influence.rate_nm_s, time_s, values
    )


@settings(max_examples=60)
@given(convolutions())
def test_convolution_is_the_direct_sum_without_wrap_around(case):
    convolution, target, source, influence, random = case
    time_s = random.normal(size=(source.ny, source.nx))
    half_y, half_x = (size // 2 for size in influence.rate_nm_s.shape)
    row0 = round((target.y0_mm - source.y0_mm) / target.pixel_mm)
    column0 = round((target.x0_mm - source.x0_mm) / target.pixel_mm)
    direct = np.zeros((target.ny, target.nx))
    for row in range(target.ny):
        for column in range(target.nx):
            down = row0 + row - np.arange(source.ny)
            right = column0 + column - np.arange(source.nx)
            near_y, near_x = np.abs(down) <= half_y, np.abs(right) <= half_x
            kernel = influence.rate_nm_s[np.ix_(down[near_y] + half_y, right[near_x] + half_x)]
            direct[row, column] = (kernel * time_s[np.ix_(near_y, near_x)]).sum()
    scale = np.abs(influence.rate_nm_s).sum() * np.abs(time_s).max()
    assert np.abs(convolution(time_s) - direct).max() <= RELATIVE * scale


@given(SEEDS, st.integers(1, 40), st.integers(1, 4))
def test_removal_operator(seed, steps, pieces):
    random = np.random.default_rng(seed)
    target = Grid(*(int(size) for size in random.integers(2, 30, size=2)), 0.2, -2.0, 1.0)
    influence = InfluenceFunction(random.normal(size=(9, 7)) ** 2 + 0.1, float(random.choice([0.2, 0.13, 0.4])))
    points = steps * pieces
    x_mm, y_mm = random.uniform(-6, 6, size=points), random.uniform(-4, 6, size=points)
    operator = RemovalOperator(
        target, influence, x_mm, y_mm, random.uniform(size=points), pieces * np.arange(steps + 1)
    )
    assert operator.steps == steps
    time_s, values = random.normal(size=steps), random.normal(size=(target.ny, target.nx))
    assert same(
        float((operator(time_s) * values).sum()),
        float(time_s @ operator.adjoint(values)),
        influence.resampled(0.2).rate_nm_s,
        time_s,
        values,
        np.ones(pieces),
    )


@given(SEEDS, st.sampled_from(["none", "piston", "tilt"]), st.integers(1, 5))
def test_misfit(seed, removed, cell):
    random = np.random.default_rng(seed)
    shape = tuple(random.integers(4, 30, size=2))
    mask = random.uniform(size=shape) < 0.8
    mask[random.integers(shape[0]), random.integers(shape[1])] = True
    surface = SurfaceMap.centred(np.where(mask, random.normal(size=shape), np.nan), 0.3)
    influence = InfluenceFunction(random.normal(size=(9, 9)) ** 2 + 0.1, 0.2)
    misfit = make_misfit(surface, mask, influence, removed, cell)
    removal, values = random.normal(size=misfit.mask.shape), random.normal(size=misfit.target.size)
    one, other = float(misfit.of(removal) @ values), float((removal * misfit.adjoint(values)).sum())
    assert same(one, other, removal, values)
    assert abs(float((misfit.root_weight**2).sum()) - 1) < RELATIVE
    # The averaged influence function removes the same volume.
    np.testing.assert_allclose(misfit.influence.volume_rate_nm_mm2_s, influence.volume_rate_nm_mm2_s, rtol=1e-12)


@given(SEEDS, st.sampled_from(["none", "piston", "tilt"]), st.booleans())
def test_levelling_is_an_orthogonal_projection(seed, removed, weighted):
    random = np.random.default_rng(seed)
    mask = random.uniform(size=random.integers(1, 25, size=2)) < 0.7
    mask[0, 0] = True
    weight = random.uniform(0.1, 2.0, size=mask.sum()) if weighted else None
    levelling = Levelling.over(mask, removed, weight)
    rows, columns = np.nonzero(mask)
    one, other = random.normal(size=(2, rows.size))
    once = levelling(one)
    np.testing.assert_allclose(levelling(once), once, atol=1e-12)
    assert same(float(once @ other), float(one @ levelling(other)), one, other)
    # What it takes out it takes out whole, and nothing else; tilt about any origin.
    free = {"none": [], "piston": [1.0], "tilt": [1.0, 3.0 + columns, 7.0 - rows]}[removed]
    root = np.ones(rows.size) if weight is None else weight
    for term in free:
        np.testing.assert_allclose(levelling(term * root), 0.0, atol=1e-9)
    taken = one - once
    basis = np.stack([np.broadcast_to(term, rows.shape) * root for term in free]) if free else np.zeros((1, rows.size))
    fitted = np.linalg.lstsq(basis.T, taken, rcond=None)[0] @ basis
    np.testing.assert_allclose(taken, fitted, atol=1e-9)
