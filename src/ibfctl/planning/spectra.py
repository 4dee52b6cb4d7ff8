"""Power spectral densities of a plan's surface before and after."""

from __future__ import annotations

from dataclasses import dataclass

from ibfctl.planning.plan import Prediction
from ibfctl.surface.psd import Spectrum, psd_along, psd_radial


@dataclass(frozen=True)
class Change:
    """Spectra of the same pixels before and after; frequencies and weights are the same."""

    before: Spectrum
    after: Spectrum


def spectra(prediction: Prediction, pixel_mm: float) -> dict[str, Change]:
    """Spectra by "x", "y" and "radial", of the levelled map and of the executed residual."""
    maps_nm = prediction.initial_nm, prediction.executed_residual_nm
    return {
        "x": Change(*(psd_along(height_nm, pixel_mm, "x") for height_nm in maps_nm)),
        "y": Change(*(psd_along(height_nm, pixel_mm, "y") for height_nm in maps_nm)),
        "radial": Change(*(psd_radial(height_nm, pixel_mm) for height_nm in maps_nm)),
    }
