from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np
import pytest
from support.programs import machine, program

from ibfctl.errors import ControllerError, LimitsError, RunError
from ibfctl.machine.controller import MotionController
from ibfctl.machine.description import MachineDescription
from ibfctl.machine.program import PvtProgram
from ibfctl.runs.preflight import check_clock, check_program


def with_axis(job: PvtProgram, letter: str, **changes: object) -> PvtProgram:
    return replace(job, axes={**job.axes, letter: replace(job.axes[letter], **changes)})  # type: ignore[arg-type]


def test_a_program_for_this_machine_passes() -> None:
    check_program(program(100), machine())


def test_another_machine_is_refused() -> None:
    job = program(100)
    with pytest.raises(RunError, match="sample period"):
        check_program(replace(job, sample_period_s=0.001), machine())
    with pytest.raises(RunError, match="counts/mm"):
        check_program(with_axis(job, "A", counts_per_mm=-1000.0), machine())
    with pytest.raises(RunError, match="axis A: y"):
        check_program(replace(job, coordinates={"x": "B", "y": "A"}), machine())
    with pytest.raises(RunError, match="axes A, here AB"):
        check_program(replace(job, axes={"A": job.axes["A"]}, coordinates={"x": "A"}), machine())


@pytest.mark.parametrize("start_counts", [-99_000, 99_000])
def test_a_program_that_leaves_the_travel_is_refused(start_counts: int) -> None:
    with pytest.raises(LimitsError, match=r"axis A moves from .* beyond its travel"):
        check_program(program(100, start_counts=(start_counts, 0)), machine())


def test_a_bulge_between_nodes_counts_as_motion() -> None:
    job = program(2, time_samples=2048, start_counts=(99_990, 0))
    bulging = with_axis(
        job, "A", increment_counts=np.array([0, 0]), end_velocity_counts_s=np.array([-400, 0])
    )
    with pytest.raises(LimitsError, match="axis A"):
        check_program(bulging, machine())


def machine_with_speed(v_max_mm_s: float) -> MachineDescription:
    data = machine().model_dump()
    data["axes"]["A"]["v_max_mm_s"] = v_max_mm_s
    return MachineDescription.model_validate(data)


def two_segments(move: int, end_velocity: int) -> PvtProgram:
    moves, speeds = np.array([move, move]), np.array([end_velocity, 0])
    job = program(2, time_samples=1024)
    return with_axis(job, "A", increment_counts=moves, end_velocity_counts_s=speeds)


@pytest.mark.parametrize(
    ("move", "end_velocity", "peak_mm_s"),
    [
        (1000, 0, 1.5),  # from rest to rest the peak is in the middle, 3/2 of the mean
        (1000, 2000, 2.0),  # at the node, the highest of a parabola that turns there
        (1000, 1000, 4 / 3),  # inside: 4 t - 3 t² for a start from rest
    ],
)
def test_the_peak_speed_counts_wherever_it_is(move: int, end_velocity: int, peak_mm_s: float) -> None:
    job = two_segments(move, end_velocity)
    check_program(job, machine_with_speed(peak_mm_s * 1.0005))
    with pytest.raises(LimitsError, match=f"axis A reaches {peak_mm_s:.3f} mm/s"):
        check_program(job, machine_with_speed(peak_mm_s * 0.99))


@pytest.mark.parametrize("samples", [0, 3, 2050])
def test_impossible_times_are_refused(samples: int) -> None:
    with pytest.raises(LimitsError, match="even"):
        check_program(replace(program(3), time_samples=np.array([60, samples, 60])), machine())


def test_a_program_must_end_at_rest_and_hold_something() -> None:
    with pytest.raises(LimitsError, match="rest"):
        check_program(with_axis(program(3), "B", end_velocity_counts_s=np.array([0, 0, 5])), machine())
    with pytest.raises(LimitsError):
        check_program(replace(program(3), time_samples=np.array([], dtype=np.int64)), machine())


class Clock:
    """A controller that has only a clock, and remembers how long it was watched."""

    def __init__(self, *periods_s: float) -> None:
        self._periods_s = list(periods_s)
        self.watched_s: list[float] = []

    def measure_sample_period_s(self, duration_s: float) -> float:
        self.watched_s.append(duration_s)
        return self._periods_s.pop(0)


def check(clock: Clock, time_scale: float = 1.0) -> float:
    return check_clock(cast(MotionController, clock), 1 / 1024, time_scale)


def test_the_right_clock_is_accepted_at_once() -> None:
    assert check(Clock(1 / 1024 * 1.00009)) == pytest.approx(1 / 1024, rel=1e-4)
    assert check(Clock(1 / 102_400), time_scale=100) == pytest.approx(1 / 1024)


def test_a_doubtful_measurement_is_repeated_with_more_patience() -> None:
    clock = Clock(1 / 1024 * 1.0003, 1 / 1024 * 0.99999)
    assert check(clock) == pytest.approx(1 / 1024 * 0.99999)
    assert clock.watched_s == sorted(set(clock.watched_s))


def test_976_microseconds_are_not_a_1024th_of_a_second() -> None:
    with pytest.raises(ControllerError, match=r"lasts 976.000 us, the machine file says 976.562 us"):
        check(Clock(976e-6, 976e-6, 976e-6, 976e-6))


def test_a_millisecond_is_refused_as_soon_as_it_is_measured_twice() -> None:
    clock = Clock(0.001, 0.00100001)
    with pytest.raises(ControllerError, match="sample_period_s"):
        check(clock)
    assert len(clock.watched_s) == 2


def test_late_replies_do_not_make_a_clock_wrong() -> None:
    assert check(Clock(1 / 1024 * 1.02, 1 / 1024 * 0.993, 1 / 1024)) == pytest.approx(1 / 1024)
