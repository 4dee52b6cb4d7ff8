"""Every promise of the certificate: broken alone, it fails alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from ibfctl.machine.description import MachineDescription
from ibfctl.machine.program import AxisProgram, PvtProgram
from ibfctl.path.tool_path import ToolPath
from ibfctl.schedule.certificate import Certificate, Check, certify

Values = Mapping[str, list[float]]


@dataclass(frozen=True)
class Motion:
    """A slope in two moves that is not stopped on, a wait, and a move along y alone; and what it is certified against.

    Moves in mm, velocities in mm/s, times in samples; axis A is x.
    """

    moves: Values = field(default_factory=lambda: {"A": [10, 10, 0, 0], "B": [1, 1, 0, 3]})
    velocities: Values = field(default_factory=lambda: {"A": [10, 0, 0, 0], "B": [1, 0, 0, 0]})
    samples: tuple[int, ...] = (1024, 1024, 1024, 1024)
    counts_per_mm: Mapping[str, float] = field(default_factory=lambda: {"A": 1000.0, "B": 1000.0})
    travel_min_mm: Mapping[str, float] = field(default_factory=lambda: {"A": -30.0, "B": -30.0})
    travel_max_mm: float = 30.0
    path_y_mm: tuple[float, ...] = (0.0, 1.0, 2.0, 2.0, 5.0)
    extra_time_s: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    corridor_mm: float = 0.05
    sample_period_s: float = 1 / 1024
    machine_counts_per_mm: Mapping[str, float] | None = None
    machine_sample_period_s: float | None = None
    j_max_mm_s3: float = 400.0

    def certify(self) -> Certificate:
        axes = {}
        for letter, scale in self.counts_per_mm.items():
            increments, velocities = (
                np.rint(np.array(values[letter]) * scale).astype(np.int64) for values in (self.moves, self.velocities)
            )
            axes[letter] = AxisProgram(increments, velocities, 0, scale)
        program = PvtProgram(axes, {"x": "A", "y": "B"}, np.array(self.samples), self.sample_period_s)
        path = ToolPath(np.array([0.0, 10.0, 20.0, 20.0, 20.0]), np.array(self.path_y_mm))
        time_s = np.array(self.samples) * self.sample_period_s + self.extra_time_s
        return certify(program, self._machine(), path, time_s, np.arange(4), self.corridor_mm)

    def _machine(self) -> MachineDescription:
        axes = {
            letter: {
                "coordinate": coordinate,
                "counts_per_mm": (self.machine_counts_per_mm or self.counts_per_mm)[letter],
                "travel_min_mm": self.travel_min_mm[letter],
                "travel_max_mm": self.travel_max_mm,
                "v_max_mm_s": 20.0,
                "a_max_mm_s2": 70.0,
                "j_max_mm_s3": self.j_max_mm_s3,
            }
            for letter, coordinate in (("A", "x"), ("B", "y"))
        }
        period_s = self.machine_sample_period_s or self.sample_period_s
        return MachineDescription.model_validate(
            {"name": "bench", "sample_period_s": period_s, "axes": axes, "beam_gate": {"output": 1}}
        )


GOOD = Motion()
AT_REST = [0.0, 0.0, 0.0, 0.0]

# What breaks one promise, by that promise.
BROKEN = {
    # The slope at up to 21 mm/s, both axes alike.
    "peak_velocity_mm_s.A": replace(GOOD, velocities={"A": [21, 0, 0, 0], "B": [2.1, 0, 0, 0]}),
    # From rest to rest in less time: 6 s/h².
    "peak_acceleration_mm_s2.A": replace(
        GOOD, velocities={"A": AT_REST, "B": AT_REST}, samples=(940, 1024, 1024, 1024)
    ),
    # Against the moves in the middle of the slope, along the chord.
    "reversal_counts_s.A": replace(GOOD, velocities={"A": [-0.5, 0, 0, 0], "B": [0, 0, 0, 0]}),
    "velocity_of_standing_axis_counts_s.A": replace(GOOD, velocities={"A": [10, 0.01, 0, 0], "B": [1, 0, 0, 0]}),
    "velocity_at_end_counts_s.B": replace(GOOD, velocities={"A": [10, 0, 0, 0], "B": [1, 0, 0, 0.01]}),
    "below_travel_counts.A": replace(GOOD, travel_min_mm={"A": 0.001, "B": -30.0}),
    "above_travel_counts.A": replace(GOOD, travel_max_mm=19.999),
    "node_error_counts.B": replace(GOOD, path_y_mm=(0.0, 1.0, 2.001, 2.0, 5.0)),
    "scale_mismatch_counts_per_mm.A": replace(GOOD, machine_counts_per_mm={"A": 1000.1, "B": 1000.0}),
    "largest_increment_counts.B": replace(
        GOOD, counts_per_mm={"A": 1000.0, "B": 2e7}, velocities={"A": [10, 0, 0, 0], "B": [1, 0, 0, 0]}
    ),
    "largest_velocity_counts_s.A": replace(GOOD, counts_per_mm={"A": 4e6, "B": 1000.0}),
    # B stops in the middle of the slope, A does not.
    "excursion_mm": replace(GOOD, velocities={"A": [10, 0, 0, 0], "B": AT_REST}),
    "longest_segment_samples": replace(GOOD, samples=(1024, 1024, 1024, 2050)),
    "shortest_segment_below_two_samples": replace(GOOD, samples=(1024, 1024, -2, 1024)),
    "odd_segments": replace(GOOD, samples=(1024, 1024, 1023, 1024)),
    # At the second node, made good at the third.
    "node_time_error_samples": replace(GOOD, extra_time_s=(0.0, 3 / 1024, -3 / 1024, 0.0)),
    "sample_period_mismatch_s": replace(GOOD, machine_sample_period_s=0.001),
    "peak_jerk_mm_s3.A": replace(GOOD, j_max_mm_s3=50.0),
}


def failed(certificate: Certificate) -> list[str]:
    return [check.name for check in certificate.checks if not check.passed]


def test_a_good_motion_passes_every_check() -> None:
    certificate = GOOD.certify()
    assert certificate.passed
    assert failed(certificate) == []


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_promise_fails_its_check_and_no_other(name: str) -> None:
    certificate = BROKEN[name].certify()
    assert not certificate.passed
    assert failed(certificate) == [name]


def test_every_check_has_a_motion_that_breaks_it() -> None:
    kinds = {check.name.partition(".")[0] for check in GOOD.certify().checks}
    assert kinds == {name.partition(".")[0] for name in BROKEN}


@pytest.mark.parametrize(
    "motion",
    [
        replace(GOOD, sample_period_s=float("nan"), machine_sample_period_s=1 / 1024),
        replace(GOOD, extra_time_s=(0.0, float("nan"), 0.0, 0.0)),
        replace(GOOD, corridor_mm=float("nan")),
    ],
)
def test_what_is_no_number_never_passes(motion: Motion) -> None:
    certificate = motion.certify()
    assert not certificate.passed
    for check in certificate.checks:
        assert check.passed is False or not np.isnan([check.value, check.limit]).any()


def test_a_segment_without_time_does_not_pass() -> None:
    with np.errstate(all="ignore"):
        assert not replace(GOOD, samples=(1024, 0, 1024, 1024)).certify().passed


@pytest.mark.parametrize(
    ("value", "limit", "passed"),
    [(1.0, 1.0, True), (1.0000001, 1.0, False), (float("nan"), 1.0, False), (0.0, float("nan"), False)],
)
def test_a_check_passes_at_its_limit_and_not_beyond(value: float, limit: float, passed: bool) -> None:
    assert Check("any", value, limit).passed is passed


def test_a_certificate_without_checks_proves_nothing() -> None:
    assert not Certificate(()).passed


def test_the_summary_holds_every_check_with_value_and_limit() -> None:
    summary = BROKEN["excursion_mm"].certify().summary()
    assert summary["passed"] is False
    checks = summary["checks"]
    assert isinstance(checks, dict)
    assert checks["excursion_mm"]["limit"] == 0.05
    assert checks["excursion_mm"]["value"] > 0.05
    assert checks["excursion_mm"]["passed"] is False
    assert checks["odd_segments"] == {"value": 0.0, "limit": 0.0, "passed": True}


def test_the_sense_of_an_axis_does_not_matter() -> None:
    moves = {letter: [-value for value in values] for letter, values in GOOD.moves.items()}
    velocities = {letter: [-value for value in values] for letter, values in GOOD.velocities.items()}
    there = {check.name: check.value for check in GOOD.certify().checks if "travel" not in check.name}
    path_free = {name: value for name, value in there.items() if "node_error" not in name and "scale" not in name}
    back = {check.name: check.value for check in replace(GOOD, moves=moves, velocities=velocities).certify().checks}
    assert {name: back[name] for name in path_free} == path_free
