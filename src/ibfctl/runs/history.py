"""What the journal tells of the parts of a plan that a run has executed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from ibfctl.runs.journal import Event, Journal

Interval = tuple[int, int]


@dataclass
class LegRecord:
    """One leg as it was recorded.

    Attributes
    ----------
    first_plan_sample, open_at
        As of `ibfctl.runs.leg.Leg`.
    recorded
        The event that was on the disk before the leg began.
    armed
        Whether the states `armed` or `running` came after that: the stamps of the motion before are gone.
    ended
        Whether its worker has told what became of it.
    begun_samples
        The controller's stamp of its begin; 0 where the leg has ended and it was not known, None before.
    """

    first_plan_sample: int
    open_at: int
    recorded: Event
    armed: bool = False
    ended: bool = False
    begun_samples: int | None = None


@dataclass
class History:
    """All legs of a run, of its last tool where there are several, and what is known of their outcome.

    Attributes
    ----------
    executed
        Parts of the plan that were executed with the gate open, in samples from its begin.
    uncertainty_samples
        By how much the end of the last part may be later.
    last_leg
        The last leg; None where none was recorded.
    places
        Where the tool was seen: samples of the plan, x and y in mm.
    known_begins
        Stamps of the begin of motions of which everything is known, of earlier tools too.
    """

    executed: list[Interval] = field(default_factory=list)
    uncertainty_samples: int = 0
    last_leg: LegRecord | None = None
    places: list[tuple[int, float, float]] = field(default_factory=list)
    known_begins: set[int] = field(default_factory=set)

    @property
    def seam(self) -> int:
        """Where in the plan the run has to go on, as far as its workers have told."""
        if self.executed:
            return self.executed[-1][1]
        return 0 if self.last_leg is None else self.last_leg.first_plan_sample


def history(journal: Journal, run: str) -> History:
    """Read the history of a run."""
    found = History()
    for event in journal.events(run=run, without=("wire",)):
        _add(found, event)
    return found


def _add(found: History, event: Event) -> None:
    data = event.data
    match event.kind:
        case "leg" if "end" in data:
            _end(found, data.get("open_plan_samples"), data["uncertainty_samples"], data.get("begun_samples"))
        case "leg" if "first_plan_sample" in data:
            found.last_leg = LegRecord(data["first_plan_sample"], data["open_at"], event)
        case "state" if data["state"] in ("armed", "running") and found.last_leg is not None:
            found.last_leg.armed = True
        case "recovered":
            # All that is known now, whatever was thought before.
            found.executed.clear()
            for interval in data["executed"]:
                _end(found, interval, data["uncertainty_samples"], data.get("begun_samples"))
            if found.last_leg is not None:
                found.last_leg.ended, found.last_leg.begun_samples = True, data["begun_samples"] or 0
        case "tool":  # another plan
            found.executed.clear()
            found.places.clear()
            found.uncertainty_samples, found.last_leg = 0, None
        case "progress":
            found.places += [(place[0], place[1], place[2]) for place in data.get("places", ())]


def _end(found: History, interval: Sequence[int] | None, uncertainty_samples: int, begun: int | None) -> None:
    if found.last_leg is not None:
        found.last_leg.ended, found.last_leg.begun_samples = True, begun or 0
    if interval is not None:
        found.executed.append((interval[0], interval[1]))
        found.uncertainty_samples = uncertainty_samples
    if begun and not uncertainty_samples:
        found.known_begins.add(begun)
