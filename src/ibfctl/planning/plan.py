"""A plan: what goes in, what was decided, and what it will leave."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field

import numpy as np
from numpy.typing import NDArray

from ibfctl.machine.description import MachineDescription
from ibfctl.machine.program import PvtProgram
from ibfctl.path.figures import PathFigures, path_figures
from ibfctl.path.tool_path import ToolPath
from ibfctl.planning.aperture import pixels_of
from ibfctl.planning.bounds import step_bounds
from ibfctl.planning.options import PlanOptions
from ibfctl.schedule.certificate import Certificate, axis_cubics
from ibfctl.surface.influence import InfluenceFunction
from ibfctl.surface.levelling import peak_to_valley, rms
from ibfctl.surface.map import SurfaceMap

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class InputFile:
    """A file (or an expression) that went into a plan.

    Attributes
    ----------
    name
        As the user gave it.
    sha256
        Hash of its bytes.
    """

    name: str
    sha256: str


@dataclass(frozen=True)
class DwellPlan:
    """Dwell points and their times.

    Attributes
    ----------
    x_mm, y_mm, time_s : (n,) float64
        Middle of every segment of the path, and the time of that segment.
    """

    x_mm: FloatArray
    y_mm: FloatArray
    time_s: FloatArray


@dataclass(frozen=True)
class Prediction:
    """What is expected on the map. All arrays (ny, nx) in nm; residuals are levelled, NaN outside the aperture.

    Attributes
    ----------
    clear_aperture : (ny, nx) bool
        Pixels that count.
    initial_nm
        The map itself over the clear aperture, levelled.
    ideal_residual_nm
        After the dwell times at the dwell points.
    executed_removal_nm
        Removal along the cubics of the quantised program, over the whole map.
    executed_residual_nm
        After that removal.
    """

    clear_aperture: NDArray[np.bool_]
    initial_nm: FloatArray
    ideal_residual_nm: FloatArray
    executed_removal_nm: FloatArray
    executed_residual_nm: FloatArray


@dataclass(frozen=True)
class Round:
    """What one round of the loop reached; the first is the plain chain.

    Attributes
    ----------
    rms_nm, total_time_s
        Executed residual and run time of the best program after this round.
    accepted
        Whether the round improved on the one before.
    """

    rms_nm: float
    total_time_s: float
    accepted: bool


@dataclass(frozen=True)
class Smoothing:
    """A path with rounded corners beside the same dwell times with sharp ones.

    Attributes
    ----------
    corner_tolerance_mm, deviation_mm
        How far the motion may leave the programmed path, and a bound of how far it does.
    corners
        How many are rounded.
    sharp_executed_rms_nm, sharp_total_time_s, sharp_peak_acceleration_mm_s2
        Of the sharp path, planned in the same way; the last by axis letter.
    lowers
        What rounding lowers in the same time: "residual", "acceleration" (of both axes), both or nothing.
    """

    corner_tolerance_mm: float
    deviation_mm: float
    corners: int
    sharp_executed_rms_nm: float
    sharp_total_time_s: float
    sharp_peak_acceleration_mm_s2: Mapping[str, float]
    lowers: tuple[str, ...]


@dataclass(frozen=True)
class CurvePoint:
    """A point on the curve of residual against time, before scheduling.

    Attributes
    ----------
    total_time_s, rms_nm
        Sum of the dwell times, and the residual that they leave at their dwell points.
    chosen
        Whether the plan was made from it.
    """

    total_time_s: float
    rms_nm: float
    chosen: bool


@dataclass(frozen=True)
class Plan:
    """A plan with its proof.

    Attributes
    ----------
    machine, options
        For which machine, and what the user chose.
    path, dwell
        What was decided, on the part.
    program, certificate
        The same on the machine, and the checks on its integers.
    surface, influence, prediction
        What was given (the tool as on the machine) and is expected; None where only a schedule was asked for.
    rounds
        What each round of motion in the loop reached, the plain chain first; empty without the loop.
    trade_off
        The curve of residual against time, by rising time; empty where it was not asked for.
    smoothing
        What rounding the corners did; None where they are sharp.
    inputs
        Name and hash of every input, by role ("map", "influence", "machine", ...).
    planning_time_s
        Wall time of the planning.
    """

    machine: MachineDescription
    options: PlanOptions
    path: ToolPath
    dwell: DwellPlan
    program: PvtProgram
    certificate: Certificate
    surface: SurfaceMap | None = None
    influence: InfluenceFunction | None = None
    prediction: Prediction | None = None
    rounds: tuple[Round, ...] = ()
    inputs: Mapping[str, InputFile] = field(default_factory=dict)
    planning_time_s: float = 0.0
    trade_off: tuple[CurvePoint, ...] = ()
    smoothing: Smoothing | None = None

    def summary(self) -> dict[str, object]:
        """Return the JSON form that `ibfctl plan --json` prints; `schedule` has no residuals."""
        figures: dict[str, object] = {} if self.prediction is None else residual_figures(self.prediction)
        if self.options.v_min_mm_s is not None:
            figures["dwell_bounds"] = self._bounds_figures()
        if not self.options.placement.as_mounted:
            figures["placement"] = asdict(self.options.placement)
        if self.trade_off:
            figures["trade_off"] = [asdict(point) for point in self.trade_off]
        if self.smoothing is not None:
            figures["smoothing"] = asdict(self.smoothing)
        return figures | {
            "total_time_s": self.program.total_time_s,
            "nodes": int(self.path.x_mm.size),
            "segments": len(self.program),
            "path": asdict(self.path_figures()),
            "peak_velocity_mm_s": {letter: peak[0] for letter, peak in peaks(self.program).items()},
            "peak_acceleration_mm_s2": {letter: peak[1] for letter, peak in peaks(self.program).items()},
            "certificate": self.certificate.summary(),
            "rounds": [asdict(round_) for round_ in self.rounds],
            "planning_time_s": self.planning_time_s,
        }

    def _bounds_figures(self) -> dict[str, float]:
        """Range of the bounds, and how many of the times that were asked for lie on them, to a sample."""
        bounds, asked_s = step_bounds(self.stage_path, self.machine, self.options), self.dwell.time_s
        sample_s = self.machine.sample_period_s
        return {
            "shortest_s": float(bounds.lower_s.min()),
            "longest_s": float(bounds.upper_s.max()),
            "steps_at_shortest": int((asked_s < bounds.lower_s + sample_s).sum()),
            "steps_at_longest": int((asked_s > bounds.upper_s - sample_s).sum()),
        }

    @property
    def stage_path(self) -> ToolPath:
        """Nodes on the machine."""
        return ToolPath(*self.options.placement(self.path.x_mm, self.path.y_mm))

    def path_figures(self) -> PathFigures:
        """Figures of the path over the clear aperture, where there is one."""
        if self.surface is None or self.prediction is None:
            return path_figures(self.path)
        return path_figures(self.path, pixels_of(self.surface, self.prediction.clear_aperture))


def residual_figures(prediction: Prediction) -> dict[str, object]:
    """RMS and PV of the residuals over the clear aperture: before, after the ideal removal, after the executed one."""
    figures: dict[str, object] = {}
    for name, residual_nm in (
        ("initial", prediction.initial_nm),
        ("ideal", prediction.ideal_residual_nm),
        ("executed", prediction.executed_residual_nm),
    ):
        values = residual_nm[prediction.clear_aperture]
        figures[f"{name}_rms_nm"] = rms(values)
        figures[f"{name}_pv_nm"] = peak_to_valley(values)
    return figures


def peaks(program: PvtProgram) -> dict[str, tuple[float, float]]:
    """Peak speed in mm/s and peak acceleration in mm/s² by axis letter, from a program's integers."""
    found = {}
    for letter, axis in program.axes.items():
        cubics = axis_cubics(program, axis)
        low, high = cubics.velocity_range
        speed = max(float(high.max()), float(-low.min()))
        scale = abs(axis.counts_per_mm)
        found[letter] = speed / scale, float(cubics.peak_acceleration.max()) / scale
    return found
