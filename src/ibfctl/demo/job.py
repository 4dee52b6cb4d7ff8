"""The demo job: a flat with the figures of a published one, made from a seed.

Size, pixels, error before finishing, tool and pitch are those of Wang et al. 2023 (J. Manuf. Process. 88,
section 4): 92 x 16 mm flat, 168 x 985 pixels, 6.32 nm RMS, a tool of 5 mm diameter, a raster of 0.5 mm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray
from scipy import ndimage

from ibfctl.planning.aperture import clear_aperture_mask
from ibfctl.planning.options import PlanOptions
from ibfctl.surface.influence import InfluenceFunction, gaussian
from ibfctl.surface.levelling import Levelling, rms
from ibfctl.surface.map import Rectangle, SurfaceMap

FloatArray = NDArray[np.float64]

PAPER_SHAPE = (168, 985)
PAPER_RMS_NM = 6.32
_WIDTH_MM = 16.0
_APERTURE_LENGTH_SHARE = 92.0 / (_WIDTH_MM * PAPER_SHAPE[1] / PAPER_SHAPE[0])
_TIF_RADIUS_MM = 2.5
_TIF_FWHM_MM = 2 * _TIF_RADIUS_MM / 6 * np.sqrt(8 * np.log(2))  # the diameter holds six standard deviations
_TIF_PEAK_NM_S = 13.0
_PITCH_MM = 0.5
_SMOOTH_MM = 2.5
_SMOOTH_SHARE = 0.4
_LEGENDRE_DEGREE = 4


@dataclass(frozen=True)
class DemoJob:
    """What goes into the planner."""

    surface: SurfaceMap
    influence: InfluenceFunction
    options: PlanOptions


def demo_job(seed: int = 4, shape: tuple[int, int] = PAPER_SHAPE) -> DemoJob:
    """Make the demo job.

    Parameters
    ----------
    seed
        Of the surface error.
    shape
        Pixels (ny, nx) of the map, at the paper's pixel size; smaller shapes make a smaller part.
    """
    ny, nx = shape
    pixel_mm = _WIDTH_MM / PAPER_SHAPE[0]
    half_x_mm = 0.5 * nx * pixel_mm * _APERTURE_LENGTH_SHARE
    half_y_mm = 0.5 * ny * pixel_mm
    aperture = Rectangle(-half_x_mm, half_x_mm, -half_y_mm, half_y_mm)
    surface = SurfaceMap.centred(_error(np.random.default_rng(seed), shape, pixel_mm), pixel_mm)
    inside = clear_aperture_mask(surface, aperture)
    scale = PAPER_RMS_NM / rms(Levelling.over(inside, "tilt")(surface.height_nm[inside]))
    influence = gaussian(_TIF_FWHM_MM, _TIF_PEAK_NM_S, _TIF_RADIUS_MM, pixel_mm)
    options = PlanOptions(clear_aperture=aperture, pitch_mm=_PITCH_MM, step_mm=_PITCH_MM)
    return DemoJob(SurfaceMap.centred(scale * surface.height_nm, pixel_mm), influence, options)


def _error(random: np.random.Generator, shape: tuple[int, int], pixel_mm: float) -> FloatArray:
    """Low-order polynomials, lower along the short side, plus a smooth random part; of any scale."""
    degree = np.add.outer(2 * np.arange(_LEGENDRE_DEGREE // 2 + 1), np.arange(_LEGENDRE_DEGREE + 1))
    weight = np.where((degree >= 2) & (degree <= _LEGENDRE_DEGREE), 1.0 / np.maximum(degree, 1), 0.0)
    weight[1, 0] = 0.0  # tilt along y
    y, x = (np.linspace(-1, 1, size) for size in shape)
    form = legendre.leggrid2d(y, x, weight * random.normal(size=weight.shape))
    smooth = ndimage.gaussian_filter(random.normal(size=shape), _SMOOTH_MM / pixel_mm, mode="reflect")
    return np.asarray(form / form.std() + _SMOOTH_SHARE * smooth / smooth.std())
