"""How sure a predicted residual is: Monte-Carlo over what differs from run to run, and which cause dominates.

All draws are made here from one seed and computed by any executor of `concurrent.futures`, so that the outcome does not
depend on how many workers there are, or where.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, as_completed
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from ibfctl.dwell.solver import Cancelled, never
from ibfctl.errors import CancelledError, InputError
from ibfctl.planning.plan import Plan
from ibfctl.planning.tolerance_draws import Draw, residuals, situation_of

FloatArray = NDArray[np.float64]
Progress = Callable[[str, float], None]

PERCENTILES = (5, 25, 50, 75, 95, 99)
# Of one piece of work: short enough to stop within a second, long enough to be worth sending.
_PIXELS_PER_PIECE, _DRAWS_PER_PIECE = 1_000_000, 30


@dataclass(frozen=True)
class Tolerances:
    """Standard deviations of the causes, all normal and independent; zero leaves a cause out.

    Attributes
    ----------
    rate_drift_percent
        Change of the removal rate from the beginning of the run to its end.
    tif_width_percent
        Width of the influence function at the same volume rate.
    offset_mm, rotation_mrad
        Registration of the part: along x and along y, and about the middle of the clear aperture.
    servo_lag_ms
        Following error over velocity, of each axis by itself.
    height_noise_nm
        Of the measured heights, from pixel to pixel.
    """

    rate_drift_percent: float = 1.0
    tif_width_percent: float = 1.0
    offset_mm: float = 0.05
    rotation_mrad: float = 0.5
    servo_lag_ms: float = 5.0
    height_noise_nm: float = 0.1

    def causes(self) -> dict[str, dict[str, float]]:
        """Return the standard deviations by cause and attribute of a draw."""
        offset, lag = self.offset_mm, 1e-3 * self.servo_lag_ms
        return {
            "rate_drift": {"rate_drift": 0.01 * self.rate_drift_percent},
            "tif_width": {"tif_width": 0.01 * self.tif_width_percent},
            "offset": {"offset_x_mm": offset, "offset_y_mm": offset},
            "rotation": {"rotation_rad": 1e-3 * self.rotation_mrad},
            "servo_lag": {"lag_x_s": lag, "lag_y_s": lag},
        }


@dataclass(frozen=True)
class Distribution:
    """Distribution of a figure over the draws, in nm; percentiles by name, `p5` to `p99`."""

    mean: float
    standard_deviation: float
    percentiles: Mapping[str, float]


@dataclass(frozen=True)
class Cause:
    """What one cause does alone.

    Attributes
    ----------
    rms_nm
        Root of the mean square of the residual, over runs in which this cause alone varies.
    share
        Its part of the mean square that all causes add, one by one.
    """

    rms_nm: float
    share: float


@dataclass(frozen=True)
class ToleranceFigures:
    """Residuals to expect of a plan.

    Attributes
    ----------
    predicted_rms_nm, predicted_pv_nm
        Where nothing differs from the plan.
    rms_nm, pv_nm
        Distributions of the residual.
    causes
        By name, the strongest first.
    """

    draws: int
    seed: int
    tolerances: Tolerances
    predicted_rms_nm: float
    predicted_pv_nm: float
    rms_nm: Distribution
    pv_nm: Distribution
    causes: Mapping[str, Cause]

    def summary(self) -> dict[str, object]:
        """Return the JSON form that `ibfctl tolerance --json` prints."""
        return asdict(self) | {"dominant": next(iter(self.causes))}


def tolerance_of(
    plan: Plan,
    tolerances: Tolerances,
    executor: Executor,
    *,
    draws: int = 1000,
    seed: int = 0,
    progress: Progress = lambda stage, fraction: None,
    cancelled: Cancelled = never,
) -> ToleranceFigures:
    """Compute how a plan's residual is distributed.

    Parameters
    ----------
    executor
        Of `concurrent.futures`, or whatever behaves like one.
    draws, seed
        How many runs, and from which seed.

    Raises
    ------
    InputError
        If the plan is a mere schedule.
    CancelledError
        If `cancelled` answered True.
    """
    if not any(asdict(tolerances).values()):
        raise InputError("tolerance: nothing varies", "give at least one tolerance that is not zero")
    situation = situation_of(plan)
    if situation is None:
        raise InputError("tolerance: the plan holds no map", "make it with `ibfctl plan`, not `ibfctl schedule`")
    alone = list(_alone(tolerances))
    every = [Draw(), *(draw for _, draw in alone), *_drawn(tolerances, draws, seed)]
    piece = min(_DRAWS_PER_PIECE, max(1, _PIXELS_PER_PIECE // situation.surface.height_nm.size))
    progress("drawing runs", 0.0)
    pieces = {
        executor.submit(residuals, situation, every[first : first + piece]): first
        for first in range(0, len(every), piece)
    }
    found = np.empty((len(every), 2))
    try:
        for done, finished in enumerate(as_completed(pieces), 1):
            first = pieces[finished]
            found[first : first + piece] = finished.result()
            progress("drawing runs", done / len(pieces))
            if cancelled():
                raise CancelledError("the draws were cancelled", "start them again when wanted")
    finally:
        for unfinished in pieces:
            unfinished.cancel()
    names = [name for name, _ in alone]
    return ToleranceFigures(
        draws,
        seed,
        tolerances,
        float(found[0, 0]),
        float(found[0, 1]),
        _distribution(found[1 + len(alone) :, 0]),
        _distribution(found[1 + len(alone) :, 1]),
        _causes(names, found[: 1 + len(alone), 0] ** 2, tolerances.height_noise_nm**2),
    )


def _drawn(tolerances: Tolerances, draws: int, seed: int) -> Iterator[Draw]:
    sigma = {name: value for cause in tolerances.causes().values() for name, value in cause.items()}
    random = np.random.default_rng(seed)
    values = random.standard_normal((draws, len(sigma))) * np.array(list(sigma.values()))
    noise = random.integers(2**63, size=draws)
    for row, noise_seed in zip(values, noise, strict=True):
        changed = {name: float(value) for name, value in zip(sigma, row, strict=True)}
        yield Draw(**changed, height_noise_nm=tolerances.height_noise_nm, noise_seed=int(noise_seed))


def _alone(tolerances: Tolerances) -> Iterator[tuple[str, Draw]]:
    """Yield the two outer points of the three-point Gauss-Hermite rule for every attribute that varies."""
    for cause, sigmas in tolerances.causes().items():
        for name, sigma in sigmas.items():
            if sigma:
                for sign in (-1, 1):
                    yield cause, Draw(**{name: sign * math.sqrt(3) * sigma}, noise_seed=0)


def _causes(names: list[str], square_nm2: FloatArray, noise_nm2: float) -> dict[str, Cause]:
    """Return the causes; the rule's outer points weigh 1/6 each, so that a quartic is integrated exactly."""
    planned_nm2 = float(square_nm2[0])
    added_nm2 = dict.fromkeys(names, 0.0)
    for name, value_nm2 in zip(names, square_nm2[1:], strict=True):
        added_nm2[name] += (float(value_nm2) - planned_nm2) / 6
    if noise_nm2:
        added_nm2["height_noise"] = noise_nm2
    total_nm2 = sum(max(0.0, value_nm2) for value_nm2 in added_nm2.values())
    share = 1 / total_nm2 if total_nm2 else 0.0
    strongest = sorted(added_nm2.items(), key=lambda item: -item[1])
    return {
        name: Cause(math.sqrt(max(0.0, planned_nm2 + value_nm2)), max(0.0, value_nm2) * share)
        for name, value_nm2 in strongest
    }


def _distribution(values: FloatArray) -> Distribution:
    percentiles = np.percentile(values, PERCENTILES)
    return Distribution(
        float(values.mean()),
        float(values.std()),
        {f"p{number}": float(value) for number, value in zip(PERCENTILES, percentiles, strict=True)},
    )
