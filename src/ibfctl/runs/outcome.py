"""What a run reports while it goes on, and what it proves when it is over."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class RunProgress:
    """One status line of a run.

    Attributes
    ----------
    sent, executed, total
        Segments given to the controller, executed by it, and in the program.
    margin_s
        Motion that the buffer surely still holds, in seconds of the controller.
    gate_open
        Whether the beam gate's output reads open.
    plan_sample
        Where in the plan the tool is, in samples from its begin.
    segment
        Segment of the plan that is.
    position_mm
        Where the stages are, by coordinate.
    minimum_margin_s
        The least margin so far.
    """

    sent: int
    executed: int
    total: int
    margin_s: float
    gate_open: bool
    plan_sample: int
    segment: int
    position_mm: Mapping[str, float]
    minimum_margin_s: float


@dataclass(frozen=True)
class RunOutcome:
    """Proof of a completed run; a run that cannot prove itself raises instead.

    Attributes
    ----------
    segments_sent, segments_executed
        Segments of the program, without the end marker; equal on every axis.
    stop_codes
        The controller's stop code per axis letter; 31, PVT ended normally.
    final_position_error_counts
        Encoder position at rest minus the program's end, per axis letter.
    minimum_buffer_margin_s
        The least motion that the buffer surely held while there was more to send, in controller seconds.
    duration_s
        Duration of the motion in controller seconds.
    wall_s
        Duration of the whole run on the host's clock, with approach and filling.
    sample_period_s
        The controller's sample period as measured before the run, in controller seconds.
    """

    segments_sent: int
    segments_executed: int
    stop_codes: Mapping[str, int]
    final_position_error_counts: Mapping[str, int]
    minimum_buffer_margin_s: float
    duration_s: float
    wall_s: float
    sample_period_s: float
