"""The tools of a run: each follows a plan of its own and has a run file of its own.

The journal says which tool is under way (`tool`, counted from one). A tool whose plan was made anew, because the ones
before it missed, follows the file `plan.tool<n>.h5`; it is there before that tool is run, and holds all later ones.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ibfctl.dwell.solver import Cancelled, never
from ibfctl.planning.advance import Advance
from ibfctl.planning.as_run import as_run_together
from ibfctl.planning.file import read_plans, read_sequence, write_sequence
from ibfctl.planning.plan import InputFile, Plan
from ibfctl.runs.journal import Journal
from ibfctl.runs.places import PLAN, RUN, journal_beside
from ibfctl.runs.run_file import read_as_run, write_tools_run


@dataclass(frozen=True)
class Part:
    """One tool of a run; the whole run where there is only one.

    Attributes
    ----------
    plans
        Those that the tools follow, in their order.
    tool
        Which one, counted from one.
    """

    plans: tuple[Plan, ...]
    tool: int

    @property
    def plan(self) -> Plan:
        """What this tool follows."""
        return self.plans[self.tool - 1]

    @property
    def total_samples(self) -> int:
        """Length of its plan."""
        return int(self.plan.program.time_samples.sum())

    @property
    def is_last(self) -> bool:
        """Whether the run is over after it."""
        return self.tool == len(self.plans)

    def file(self, folder: Path) -> Path:
        """Return its run file in the folder of the run."""
        return folder / RUN if len(self.plans) == 1 else _run_file(folder, self.tool)

    def wanted(self) -> dict[str, str]:
        """Say what is to be done before the next tool, as `reason` and `hint`."""
        influence = self.plans[self.tool].inputs.get("influence")
        name = f" ({influence.name})" if influence is not None else ""
        return {
            "reason": f"tool {self.tool + 1} of {len(self.plans)}{name} is to be mounted",
            "hint": "mount it, home the machine if it lost its place, then confirm",
        }


def tool_under_way(journal: Journal, run: str) -> int:
    """Return which tool of a run is under way, or was last."""
    event = journal.last(run, "tool")
    return 1 if event is None else int(event.data["tool"])


def part_of(folder: Path, tool: int) -> Part:
    """Read what the tools of the run in `folder` follow.

    Raises
    ------
    InputError
        As `read_plans` does.
    """
    plans = read_plans(folder / PLAN)
    for number in range(2, len(plans) + 1):
        anew = _plan_file(folder, number)
        if anew.is_file():
            plans = plans[: number - 1] + read_plans(anew)
    return Part(plans, tool)


def part_under_way(folder: Path) -> Part:
    """Read what is under way of the run in `folder`; all else as `part_of`."""
    with Journal.open(journal_beside(folder)) as journal:
        return part_of(folder, tool_under_way(journal, folder.name))


def next_part(folder: Path, part: Part, cancelled: Cancelled = never) -> Part:
    """Return the tool after one that was executed to its end; if need be, plan it and all later ones anew.

    Raises
    ------
    InputError, LimitsError, SolverError, CancelledError
        As `replan_later` does.
    """
    anew = _plan_file(folder, part.tool + 1)
    if not anew.is_file():
        advance = Advance.none(read_sequence(folder / PLAN))
        for number in range(1, part.tool + 1):
            if _plan_file(folder, number).is_file():
                advance = advance.following(read_plans(_plan_file(folder, number)))
            as_run = read_as_run(_run_file(folder, number))
            advance = advance.by(np.zeros_like(advance.removed_nm) if as_run is None else as_run.removal_nm)
        if advance.missed:
            write_sequence(advance.replanned(cancelled), anew)
    return part_of(folder, part.tool + 1)


def record_together(folder: Path, part: Part) -> None:
    """Write what all tools up to `part` have left together, from their run files.

    Raises
    ------
    InputError
        If a file cannot be read or written.
    """
    sequence = read_sequence(folder / PLAN)
    removed_nm = np.zeros(sequence.surface.height_nm.shape)
    tools = []
    for number in range(1, part.tool + 1):
        run, anew = _run_file(folder, number), _plan_file(folder, number)
        as_run = read_as_run(run)
        if as_run is not None:
            removed_nm = removed_nm + as_run.removal_nm
        tools.append({"run": run.name, "replanned": anew.name if anew.is_file() else None})
    write_tools_run(folder / RUN, sequence, plan_input(folder), tools, as_run_together(sequence, removed_nm))


def plan_input(folder: Path) -> InputFile:
    """Return name and hash of a run's plan."""
    with (folder / PLAN).open("rb") as stream:
        return InputFile(PLAN, hashlib.file_digest(stream, "sha256").hexdigest())


def _run_file(folder: Path, tool: int) -> Path:
    return folder / f"run.tool{tool}.h5"


def _plan_file(folder: Path, tool: int) -> Path:
    return folder / f"plan.tool{tool}.h5"
