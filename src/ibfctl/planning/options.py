"""What the user may choose about a plan."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from ibfctl.dwell.trade_off import Aim
from ibfctl.errors import InputError
from ibfctl.machine.placement import AS_MOUNTED, Placement
from ibfctl.surface.regions import Region
from ibfctl.surface.terms import Removed

__all__ = ["Aim", "Bounds", "MadePath", "PlanOptions", "Removed"]

Bounds = Literal["machine", "ramp"]
MadePath = Literal["raster", "maze", "spiral", "random"]

# Finer lines cost time at every turn and every limited step, and leave no smaller residual.
PITCH_SHARE = 0.25


@dataclass(frozen=True)
class PlanOptions:
    """Choices for one plan; the defaults work for an ordinary part.

    Attributes
    ----------
    path
        "raster", "maze", "spiral", "random" (adaptive: denser where more is to go), or a CSV file of nodes
        (`x_mm,y_mm`); "nodes" marks a schedule of given nodes.
    pitch_mm, step_mm
        Distance between lines and between nodes along a line; a maze has its pitch alone. None for a quarter of the
        tool's full width at half maximum, and for a step like the pitch; a plan's options hold what was chosen.
    scan_axis
        Axis along which the raster's lines run.
    seed
        Of a random path.
    inside_out
        Whether a spiral starts in the middle.
    clear_aperture
        Where the residual counts; None for the whole valid map.
    remove
        Terms that are free in what was measured, and hence in the plan and its figures, see `Removed`.
    extra_removal_nm
        Depth that every place of the clear aperture must lose: `remove` is then taken out of the map, and nothing is
        free. None for none.
    dwell_min_s
        Lower bound on every dwell time, above what the machine's limits ask for; None for the machine's own.
    v_min_mm_s
        Slowest mean speed over a step, an upper bound on every dwell time; None for none.
    dwell_bounds
        "machine" for the shortest times of the machine itself and the slowest speed; "ramp" for those of linear ramps
        between a slowest and a fastest speed as well (Zhang et al. 2021, Eq. 17).
    placement
        How the part stands on the machine: path and removal are in part coordinates, the program in the machine's.
    corridor_mm
        How far the executed path may leave its programmed segment; None for 5 % of the pitch.
    corner_tolerance_mm
        Round the corners so that the motion leaves the programmed path by no more than this; None for sharp corners.
    loop
        Whether dwell times are corrected for the motion that is really executed.
    aim
        Balance of residual and time.
    tikhonov
        Tikhonov factor relative to the largest eigenvalue of the removal operator's normal operator.
    l_curve
        Whether the factor is found at the corner of the L-curve; the plan's options then hold what was found.
    trade_off
        Whether the whole curve of residual against time goes into the plan.
    """

    path: MadePath | Literal["nodes"] | Path = "raster"
    pitch_mm: float | None = None
    step_mm: float | None = None
    scan_axis: Literal["x", "y"] = "x"
    seed: int = 0
    inside_out: bool = False
    clear_aperture: Region | None = None
    remove: Removed = "tilt"
    extra_removal_nm: float | None = None
    dwell_min_s: float | None = None
    v_min_mm_s: float | None = None
    dwell_bounds: Bounds = "machine"
    placement: Placement = AS_MOUNTED
    corridor_mm: float | None = None
    corner_tolerance_mm: float | None = None
    loop: bool = True
    aim: Aim = field(default_factory=Aim)
    tikhonov: float = 1e-8
    l_curve: bool = False
    trade_off: bool = False

    def spaced(self, width_mm: float) -> PlanOptions:
        """Return the options with pitch and step, for a tool of this full width at half maximum."""
        pitch_mm = PITCH_SHARE * width_mm if self.pitch_mm is None else self.pitch_mm
        return replace(self, pitch_mm=pitch_mm, step_mm=pitch_mm if self.step_mm is None else self.step_mm)

    @property
    def spacing_mm(self) -> tuple[float, float]:
        """Pitch and step of options that have them, as those of every plan."""
        if self.pitch_mm is None or self.step_mm is None:
            raise InputError("plan options: pitch and step are not chosen yet", "give --pitch-mm and --step-mm")
        return self.pitch_mm, self.step_mm
