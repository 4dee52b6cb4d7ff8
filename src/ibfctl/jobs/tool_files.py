"""From the files of several tools to a plan file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, cast, get_args

from ibfctl.jobs.inputs import InfluenceFile, MapFile
from ibfctl.jobs.plan_files import Report, hashed
from ibfctl.machine.description import read_machine
from ibfctl.machine.shipped import shipped_machine
from ibfctl.planning.file import write_sequence
from ibfctl.planning.options import MadePath, PlanOptions
from ibfctl.planning.sequence import Method, PlanSequence
from ibfctl.planning.several import plan_sequence
from ibfctl.planning.suggest import Suggestion, suggest_tools
from ibfctl.planning.tool import Tool, usual_interval_mm
from ibfctl.surface.regions import MaskFile


@dataclass(frozen=True)
class ToolFile:
    """A tool's files and what is chosen for it.

    Attributes
    ----------
    influence, machine
        Its influence function, and the machine that moves it; None for one without limits, to compare tools.
    pitch_mm, step_mm
        None for those of the other options, or the usual interval of its size.
    path, scan_axis
        A kind of path or a file of nodes, and the axis of a raster's lines; None for those of the other options.
    """

    influence: InfluenceFile
    machine: Path | None
    pitch_mm: float | None = None
    step_mm: float | None = None
    path: str | None = None
    scan_axis: str | None = None

    def read(self, options: PlanOptions) -> Tool:
        """Read the files; what is not chosen for this tool is taken from `options`."""
        influence = self.influence.read()
        interval_mm = usual_interval_mm(influence)
        options = replace(
            options,
            pitch_mm=self.pitch_mm or options.pitch_mm or interval_mm,
            step_mm=self.step_mm or options.step_mm or self.pitch_mm or options.pitch_mm or interval_mm,
        )
        if self.path is not None:
            made = self.path in get_args(MadePath)
            options = replace(options, path=cast("MadePath", self.path) if made else Path(self.path))
        if self.scan_axis is not None:
            options = replace(options, scan_axis=cast('Literal["x", "y"]', self.scan_axis))
        inputs = {"influence": hashed(self.influence.spec)}
        machine = read_machine(shipped_machine("simulator")).without_limits()
        if self.machine is not None:
            machine = read_machine(self.machine)
            inputs["machine"] = hashed(self.machine)
        if isinstance(options.path, Path):
            inputs["path"] = hashed(options.path)
        return Tool(influence, machine, options, inputs)


def plan_tool_files(
    surface: MapFile,
    tools: Sequence[ToolFile],
    options: PlanOptions,
    output: Path,
    method: Method = "ours",
    tool_change_s: float = 0.0,
    *,
    on_progress: Report | None = None,
    cancelled: Callable[[], bool] = lambda: False,
) -> PlanSequence:
    """Plan a job of several tools from files and write the plan to `output`.

    Raises
    ------
    InputError, LimitsError, SolverError, CancelledError
        As `plan_sequence` and the readers do; nothing is written then.
    """
    inputs = {"map": hashed(surface.path)}
    if isinstance(options.clear_aperture, MaskFile):
        inputs["mask"] = hashed(options.clear_aperture.path)
    read = [tool.read(options) for tool in tools]
    sequence = plan_sequence(
        surface.read(),
        [replace(tool, inputs={**inputs, **tool.inputs}) for tool in read],
        method=method,
        tool_change_s=tool_change_s,
        progress=on_progress,
        cancelled=cancelled,
        inputs=inputs,
    )
    write_sequence(sequence, output)
    return sequence


def suggest_files(
    surface: MapFile,
    tools: Sequence[ToolFile],
    options: PlanOptions,
    tool_change_s: float = 0.0,
    *,
    on_progress: Report | None = None,
    cancelled: Callable[[], bool] = lambda: False,
) -> Suggestion:
    """Compare the subsets of several tools from files.

    Raises
    ------
    InputError, LimitsError, CancelledError
        As `suggest_tools` and the readers do.
    """
    return suggest_tools(
        surface.read(),
        [tool.read(options) for tool in tools],
        tool_change_s=tool_change_s,
        progress=on_progress,
        cancelled=cancelled,
    )
