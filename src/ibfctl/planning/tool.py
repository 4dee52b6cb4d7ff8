"""One tool that a plan of several may use."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from ibfctl.machine.description import MachineDescription
from ibfctl.planning.options import PlanOptions
from ibfctl.planning.plan import InputFile
from ibfctl.surface.influence import InfluenceFunction


@dataclass(frozen=True)
class Tool:
    """A tool, the stages that move it, and how.

    Attributes
    ----------
    influence, machine
        What it removes, and its limits.
    options
        Its path, pitch and step; the rest is the same for all tools of a plan.
    inputs
        Names and hashes of its own files.
    """

    influence: InfluenceFunction
    machine: MachineDescription
    options: PlanOptions
    inputs: Mapping[str, InputFile] = field(default_factory=dict)


def usual_interval_mm(influence: InfluenceFunction) -> float:
    """Distance between lines and between dwell points that keeps waviness low (Ke et al. 2022, Eq. 9)."""
    return math.pi * 2 * influence.radius_mm / 18
