"""Several tools on one part: a plan for each, in the order in which they run.

The plan of a tool is a plan like any other. Its map is what the tools before it are predicted to leave, so it can be
run, proved and replaced by itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from ibfctl.dwell.methods.smoothness import slope_rms_s_mm
from ibfctl.dwell.misfit import full_width_mm
from ibfctl.planning.plan import InputFile, Plan, Prediction, Round, residual_figures
from ibfctl.surface.map import SurfaceMap

Method = Literal["ours", "mto", "sto"]


@dataclass(frozen=True)
class PlanSequence:
    """Plans of several tools, the widest first.

    Attributes
    ----------
    plans
        One per tool. Between two of them the tool is changed and the machine referenced anew.
    surface, prediction
        The map before the first tool, and what all together leave of it. With an extra removal, heights are all that
        is to go, and nothing is free any more.
    method
        How the dwell times were found.
    tool_change_s
        Time of a change of tools.
    rounds
        What motion in the loop reached, tool after tool, in residual and run time of all together.
    inputs
        Name and hash of what all tools share, by role; each plan has its own as well.
    planning_time_s
        Wall time of the planning.
    """

    plans: tuple[Plan, ...]
    surface: SurfaceMap
    prediction: Prediction
    method: Method
    tool_change_s: float
    rounds: tuple[Round, ...] = ()
    inputs: Mapping[str, InputFile] = field(default_factory=dict)
    planning_time_s: float = 0.0

    @property
    def beam_time_s(self) -> float:
        """Run time of all programs, without changes of tools."""
        return sum(plan.program.total_time_s for plan in self.plans)

    @property
    def total_time_s(self) -> float:
        """Run time of all programs, with changes of tools."""
        return self.beam_time_s + self.tool_change_s * (len(self.plans) - 1)

    def summary(self) -> dict[str, object]:
        """Return the JSON form of `ibfctl plan --tool ... --json`: a plan's keys over all tools, and each tool's."""
        each: list[dict[str, Any]] = [plan.summary() for plan in self.plans]
        checks = {
            f"tool {number}: {name}": check
            for number, figures in enumerate(each, 1)
            for name, check in figures["certificate"]["checks"].items()
        }
        paths = [figures["path"] for figures in each]
        return residual_figures(self.prediction) | {
            "total_time_s": self.total_time_s,
            "beam_time_s": self.beam_time_s,
            "tool_change_s": self.tool_change_s,
            "nodes": sum(figures["nodes"] for figures in each),
            "segments": sum(figures["segments"] for figures in each),
            "path": {
                "length_mm": sum(path["length_mm"] for path in paths),
                "shortest_step_mm": min(path["shortest_step_mm"] for path in paths),
                "sharpest_corner_deg": max(path["sharpest_corner_deg"] for path in paths),
                "largest_gap_mm": min(path["largest_gap_mm"] for path in paths),
            },
            "peak_velocity_mm_s": _highest([figures["peak_velocity_mm_s"] for figures in each]),
            "peak_acceleration_mm_s2": _highest([figures["peak_acceleration_mm_s2"] for figures in each]),
            "certificate": {"passed": all(check["passed"] for check in checks.values()), "checks": checks},
            "rounds": [asdict(round_) for round_ in self.rounds],
            "planning_time_s": self.planning_time_s,
            "method": self.method,
            "tools": [
                {
                    "influence": plan.inputs["influence"].name if "influence" in plan.inputs else None,
                    "full_width_mm": full_width_mm(plan.influence) if plan.influence is not None else None,
                    "pitch_mm": plan.options.pitch_mm,
                    "step_mm": plan.options.step_mm,
                    "slope_rms_s_mm": slope_rms_s_mm(plan.path, plan.dwell.time_s),
                }
                | figures
                for plan, figures in zip(self.plans, each, strict=True)
            ],
        }


def _highest(peaks: list[dict[str, float]]) -> dict[str, float]:
    """Largest value by axis letter; tools may have machines of different axes."""
    return {letter: max(peak[letter] for peak in peaks if letter in peak) for letter in sorted(set().union(*peaks))}
