"""How far the tools of a plan have come, and whether the later ones have to be planned anew."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ibfctl.dwell.solver import Cancelled, never
from ibfctl.errors import InputError
from ibfctl.planning.plan import Plan
from ibfctl.planning.sequence import PlanSequence
from ibfctl.planning.several import replan_later
from ibfctl.surface.levelling import rms

FloatArray = NDArray[np.float64]

TOLERATED = 0.1
"""Difference between removed and predicted, as a share of the predicted residual, that later tools may inherit."""


@dataclass(frozen=True)
class Advance:
    """What the first tools of a plan have removed.

    Attributes
    ----------
    sequence
        The plan; its later tools as they are followed now.
    removed_nm, predicted_nm : (ny, nx)
        What the tools that have run have removed, and what the later ones take to have been removed.
    done
        How many tools have run.
    """

    sequence: PlanSequence
    removed_nm: FloatArray
    predicted_nm: FloatArray
    done: int = 0

    @classmethod
    def none(cls, sequence: PlanSequence) -> Advance:
        """Return the state before the first tool."""
        nothing_nm = np.zeros(sequence.surface.height_nm.shape)
        return cls(sequence, nothing_nm, nothing_nm)

    def by(self, removal_nm: FloatArray) -> Advance:
        """Return the state after the next tool, which has removed `removal_nm` (ny, nx)."""
        prediction = self.sequence.plans[self.done].prediction
        if prediction is None:
            raise InputError("plan of several tools: holds no map", "make it with `ibfctl plan --tool`")
        predicted_nm = self.predicted_nm + prediction.executed_removal_nm
        return Advance(self.sequence, self.removed_nm + removal_nm, predicted_nm, self.done + 1)

    @property
    def missed(self) -> bool:
        """Whether tools are left, and what was removed is not what they were planned for."""
        last = self.sequence.plans[-1].prediction
        if self.done == len(self.sequence.plans) or last is None:
            return False
        aperture = self.sequence.prediction.clear_aperture
        missed_nm = (self.removed_nm - self.predicted_nm)[aperture]
        return rms(missed_nm) > TOLERATED * rms(last.executed_residual_nm[aperture])

    def replanned(self, cancelled: Cancelled = never) -> PlanSequence:
        """Plan the later tools for what is left; all else as `replan_later`."""
        return replan_later(self.sequence, self.done, self.removed_nm, cancelled=cancelled)

    def following(self, later: Sequence[Plan]) -> Advance:
        """Return the same state with other plans for the later tools, made for what was removed."""
        plans = (*self.sequence.plans[: self.done], *later)
        return replace(self, sequence=replace(self.sequence, plans=plans), predicted_nm=self.removed_nm)
