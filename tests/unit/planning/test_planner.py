"""The planner from map to certified program on a small part: 12 x 8 mm, a tool of 4 mm, steps of 1 mm."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ibfctl.errors import CancelledError, InputError, LimitsError
from ibfctl.machine.description import MachineDescription, read_machine
from ibfctl.machine.shipped import shipped_machine
from ibfctl.planning.as_run import as_run_figures
from ibfctl.planning.options import PlanOptions
from ibfctl.planning.plan import InputFile, Plan
from ibfctl.planning.planner import make_plan, schedule_nodes
from ibfctl.schedule.certificate import axis_cubics
from ibfctl.surface.influence import InfluenceFunction, gaussian
from ibfctl.surface.levelling import rms
from ibfctl.surface.map import Rectangle, SurfaceMap
from tests.support.small_job import small_height_nm

OPTIONS = PlanOptions(pitch_mm=1.0, step_mm=1.0)
SUMMARY_KEYS = {
    "initial_rms_nm",
    "initial_pv_nm",
    "ideal_rms_nm",
    "ideal_pv_nm",
    "executed_rms_nm",
    "executed_pv_nm",
    "total_time_s",
    "nodes",
    "segments",
    "peak_velocity_mm_s",
    "peak_acceleration_mm_s2",
    "certificate",
    "planning_time_s",
}
MORE_KEYS = {"path", "rounds"}


@pytest.fixture(scope="module")
def machine() -> MachineDescription:
    return read_machine(shipped_machine("simulator"))


@pytest.fixture(scope="module")
def surface() -> SurfaceMap:
    return SurfaceMap.centred(small_height_nm(), 0.25)


@pytest.fixture(scope="module")
def tool() -> InfluenceFunction:
    return gaussian(1.6, 4.0, 2.0, 0.1)


@pytest.fixture(scope="module")
def plan(surface: SurfaceMap, tool: InfluenceFunction, machine: MachineDescription) -> Plan:
    return make_plan(surface, tool, machine, OPTIONS, inputs={"map": InputFile("map.npz", "ab" * 32)})


def figures(plan: Plan) -> tuple[float, float, float]:
    """Initial, ideal and executed residual, nm RMS."""
    summary = plan.summary()
    return tuple(summary[f"{name}_rms_nm"] for name in ("initial", "ideal", "executed"))  # type: ignore[return-value]


def test_the_residual_drops_and_the_executed_one_with_it(plan: Plan) -> None:
    initial, ideal, executed = figures(plan)
    assert initial == pytest.approx(2.4877, abs=1e-3)
    assert ideal < 0.02 * initial
    assert executed < 0.02 * initial
    assert plan.certificate.passed


def test_the_summary_has_the_promised_keys_with_plain_values(plan: Plan, machine: MachineDescription) -> None:
    summary = plan.summary()
    assert set(summary) == SUMMARY_KEYS | MORE_KEYS
    for key, value in summary.items():
        if key not in {"certificate", "path", "rounds", "peak_velocity_mm_s", "peak_acceleration_mm_s2"}:
            assert type(value) in (int, float), key
    for key, limit in (("peak_velocity_mm_s", "v_max_mm_s"), ("peak_acceleration_mm_s2", "a_max_mm_s2")):
        peaks = summary[key]
        assert isinstance(peaks, dict)
        assert set(peaks) == {"A", "B"}
        assert all(0 < peaks[letter] <= getattr(axis, limit) for letter, axis in machine.axes.items())
    certificate = summary["certificate"]
    assert isinstance(certificate, dict)
    assert certificate["passed"] is True
    assert all(set(check) == {"value", "limit", "passed"} for check in certificate["checks"].values())
    assert summary["nodes"] == plan.path.x_mm.size
    assert summary["segments"] == len(plan.program)


def test_the_figures_are_those_of_the_maps_in_the_plan(plan: Plan) -> None:
    prediction, summary = plan.prediction, plan.summary()
    assert prediction is not None
    mask = prediction.clear_aperture
    for name, residual in (
        ("initial", prediction.initial_nm),
        ("ideal", prediction.ideal_residual_nm),
        ("executed", prediction.executed_residual_nm),
    ):
        assert np.array_equal(np.isfinite(residual), mask)
        assert summary[f"{name}_rms_nm"] == pytest.approx(np.sqrt((residual[mask] ** 2).mean()))
        assert summary[f"{name}_pv_nm"] == pytest.approx(residual[mask].max() - residual[mask].min())
        # Piston and tilt are free, and taken out.
        y, x = np.nonzero(mask)
        for term in (np.ones(x.size), x, y):
            assert abs(term @ residual[mask]) < 1e-6 * np.linalg.norm(term) * max(np.linalg.norm(residual[mask]), 1e-9)


def test_the_executed_residual_is_what_the_cubics_leave_sample_by_sample(plan: Plan) -> None:
    program = plan.program
    place = {}
    for coordinate in ("x", "y"):
        axis = program.axis_of(coordinate)
        cubics = axis_cubics(program, axis)
        counts = []
        for segment, samples in enumerate(program.time_samples):
            tau = program.sample_period_s * (np.arange(samples) + 0.5)
            h = cubics.time_s[segment]
            v0, v1, move = cubics.start_velocity[segment], cubics.end_velocity[segment], cubics.move[segment]
            u = tau / h
            hermite = (3 * u**2 - 2 * u**3) * move + h * ((u**3 - 2 * u**2 + u) * v0 + (u**3 - u**2) * v1)
            counts.append(cubics.start[segment] + hermite)
        # The emulator and the machine stand on whole counts.
        place[coordinate] = np.rint(np.concatenate(counts)) / axis.counts_per_mm
    run = as_run_figures(plan, place["x"], place["y"], program.sample_period_s)
    assert run.rms_difference_nm <= 0.01
    assert run.rms_nm == pytest.approx(figures(plan)[2], abs=0.01)


def test_the_plan_keeps_what_it_was_made_from(plan: Plan, surface: SurfaceMap, tool: InfluenceFunction) -> None:
    assert plan.surface is surface
    assert plan.influence is tool
    assert plan.inputs == {"map": InputFile("map.npz", "ab" * 32)}
    assert plan.planning_time_s > 0
    assert np.array_equal(plan.dwell.x_mm, plan.path.dwell_x_mm)
    # The path overruns the part by the tool's radius.
    assert plan.path.x_mm.min() <= -6 - 2
    assert plan.path.y_mm.max() >= 4 + 2


def test_planning_again_gives_the_same_integers(
    plan: Plan, surface: SurfaceMap, tool: InfluenceFunction, machine: MachineDescription
) -> None:
    again = make_plan(surface, tool, machine, OPTIONS)
    assert again.program.time_samples.tolist() == plan.program.time_samples.tolist()
    for letter, axis in plan.program.axes.items():
        assert again.program.axes[letter].increment_counts.tolist() == axis.increment_counts.tolist()
        assert again.program.axes[letter].end_velocity_counts_s.tolist() == axis.end_velocity_counts_s.tolist()


def test_the_loop_is_never_worse_than_the_plain_chain(
    plan: Plan, surface: SurfaceMap, tool: InfluenceFunction, machine: MachineDescription
) -> None:
    plain = make_plan(surface, tool, machine, replace(OPTIONS, loop=False))
    assert plain.rounds == ()
    assert figures(plan)[2] <= figures(plain)[2]
    assert plan.rounds[0].rms_nm == pytest.approx(figures(plain)[2])
    residuals = [round_.rms_nm for round_ in plan.rounds]
    assert residuals == sorted(residuals, reverse=True)


@pytest.mark.parametrize("remove", ["none", "piston"])
def test_what_is_free_in_the_map_is_free_in_the_plan_and_nothing_else(
    surface: SurfaceMap, tool: InfluenceFunction, machine: MachineDescription, remove: str
) -> None:
    plan = make_plan(surface, tool, machine, replace(OPTIONS, remove=remove))  # type: ignore[arg-type]
    initial, _, executed = figures(plan)
    prediction = plan.prediction
    assert prediction is not None
    height = surface.height_nm
    expected = rms(height) if remove == "none" else float(height.std())
    assert initial == pytest.approx(expected)
    assert executed < 0.2 * initial
    left = height - prediction.executed_removal_nm
    assert np.allclose(prediction.executed_residual_nm, left if remove == "none" else left - left.mean())


def test_dwell_times_respect_their_lower_bound(
    surface: SurfaceMap, tool: InfluenceFunction, machine: MachineDescription
) -> None:
    plan = make_plan(surface, tool, machine, replace(OPTIONS, dwell_min_s=0.2))
    assert plan.dwell.time_s.min() >= 0.2
    assert plan.program.time_samples.min() >= np.floor(0.2 * 1024) - 2
    assert figures(plan)[2] < 0.1 * figures(plan)[0]


def test_scanning_along_y(surface: SurfaceMap, tool: InfluenceFunction, machine: MachineDescription) -> None:
    plan = make_plan(surface, tool, machine, replace(OPTIONS, scan_axis="y"))
    moving_y = plan.program.axis_of("y").increment_counts != 0
    assert moving_y.mean() > 0.9
    assert figures(plan)[2] < 0.02 * figures(plan)[0]


def test_a_maze(surface: SurfaceMap, tool: InfluenceFunction, machine: MachineDescription) -> None:
    plan = make_plan(surface, tool, machine, replace(OPTIONS, path="maze", seed=3))
    steps = np.hypot(np.diff(plan.path.x_mm), np.diff(plan.path.y_mm))
    assert steps == pytest.approx(1.0)
    assert figures(plan)[2] < 0.15 * figures(plan)[0]


def test_nodes_from_a_file(
    tmp_path: Path, plan: Plan, surface: SurfaceMap, tool: InfluenceFunction, machine: MachineDescription
) -> None:
    file = tmp_path / "nodes.csv"
    rows = [f"{x!r},{y!r}" for x, y in zip(plan.path.x_mm.tolist(), plan.path.y_mm.tolist(), strict=True)]
    file.write_text("\n".join(["x_mm,y_mm", *rows]))
    same = make_plan(surface, tool, machine, replace(OPTIONS, path=file))
    assert same.program.time_samples.tolist() == plan.program.time_samples.tolist()


def test_repeated_nodes_in_a_file(
    tmp_path: Path, surface: SurfaceMap, tool: InfluenceFunction, machine: MachineDescription
) -> None:
    file = tmp_path / "nodes.csv"
    file.write_text("x_mm,y_mm\n0,0\n0,0\n3,0\n3,0\n3,0\n3,2\n3,2\n")
    plan = make_plan(surface, tool, machine, replace(OPTIONS, path=file))
    assert plan.certificate.passed
    assert plan.program.axis_of("x").end_counts == 30_000


def test_holes_in_the_map_are_left_out_and_planned_around(
    surface: SurfaceMap, tool: InfluenceFunction, machine: MachineDescription
) -> None:
    height = surface.height_nm.copy()
    height[10:14, 20:25] = np.nan
    height[0] = np.nan
    height[5, 5] = np.nan
    plan = make_plan(SurfaceMap.centred(height, 0.25), tool, machine, OPTIONS)
    assert plan.prediction is not None
    assert np.array_equal(np.isnan(plan.prediction.executed_residual_nm), np.isnan(height))
    assert np.isfinite(plan.prediction.executed_removal_nm).all()
    assert np.isfinite(plan.dwell.time_s).all()
    initial, _, executed = figures(plan)
    assert executed < 0.03 * initial


def test_only_the_clear_aperture_counts(
    surface: SurfaceMap, tool: InfluenceFunction, machine: MachineDescription
) -> None:
    aperture = Rectangle(-3.0, 3.0, -2.0, 2.0)
    height = surface.height_nm.copy()
    height[:, :4] = 1e6  # a chamfer, measured as nonsense
    plan = make_plan(SurfaceMap.centred(height, 0.25), tool, machine, replace(OPTIONS, clear_aperture=aperture))
    assert plan.prediction is not None
    x, y = np.meshgrid(surface.x_mm, surface.y_mm)
    assert np.array_equal(plan.prediction.clear_aperture, (np.abs(x) <= 3) & (np.abs(y) <= 2))
    assert figures(plan)[2] < 0.05 * figures(plan)[0]


@pytest.mark.parametrize("height_nm", [7.5])
def test_a_map_with_nothing_to_remove_is_run_over_as_fast_as_the_machine_can(
    tool: InfluenceFunction, machine: MachineDescription, height_nm: float
) -> None:
    plan = make_plan(SurfaceMap.centred(np.full((32, 48), height_nm), 0.25), tool, machine, OPTIONS)
    assert plan.certificate.passed
    assert figures(plan)[0] == pytest.approx(0.0, abs=1e-9)
    assert figures(plan)[2] < 0.1
    assert plan.program.total_time_s < 60


def test_an_aperture_smaller_than_the_tool(
    surface: SurfaceMap, tool: InfluenceFunction, machine: MachineDescription
) -> None:
    plan = make_plan(surface, tool, machine, replace(OPTIONS, clear_aperture=Rectangle(-0.7, 0.7, -0.5, 0.5)))
    assert plan.certificate.passed
    assert figures(plan)[2] < figures(plan)[0]
    assert plan.path.x_mm.min() <= -0.5 - tool.radius_mm


def test_a_measured_tool_with_noise_around_it(
    surface: SurfaceMap, tool: InfluenceFunction, machine: MachineDescription
) -> None:
    noise = 0.01 * tool.peak_rate_nm_s * np.random.default_rng(2).normal(size=tool.rate_nm_s.shape)
    plan = make_plan(surface, InfluenceFunction(tool.rate_nm_s + noise, tool.pixel_mm), machine, OPTIONS)
    assert figures(plan)[2] < 0.05 * figures(plan)[0]


def test_a_tool_whose_peak_is_not_in_the_middle_of_its_table(
    surface: SurfaceMap, tool: InfluenceFunction, machine: MachineDescription
) -> None:
    shifted = InfluenceFunction(np.pad(tool.rate_nm_s, ((10, 0), (0, 0))), tool.pixel_mm)
    plan = make_plan(surface, shifted, machine, OPTIONS)
    assert figures(plan)[2] < 0.03 * figures(plan)[0]


def test_a_spike_is_no_reason_to_fail(
    surface: SurfaceMap, tool: InfluenceFunction, machine: MachineDescription
) -> None:
    height = surface.height_nm.copy()
    height[16, 24] += 1000.0
    plan = make_plan(SurfaceMap.centred(height, 0.25), tool, machine, OPTIONS)
    assert plan.certificate.passed
    assert figures(plan)[2] < figures(plan)[0]


def test_progress_goes_from_nothing_to_all(
    surface: SurfaceMap, tool: InfluenceFunction, machine: MachineDescription
) -> None:
    seen: list[tuple[str, float]] = []
    make_plan(surface, tool, machine, OPTIONS, progress=lambda stage, share: seen.append((stage, share)))
    shares = [share for _, share in seen]
    assert shares[0] == 0.0
    assert shares[-1] == 1.0
    assert shares == sorted(shares)
    assert all(stage for stage, _ in seen)
    assert len(seen) >= 4


@pytest.mark.parametrize("asked", [0, 1, 2, 5, 20, 60])
def test_planning_ends_when_it_is_cancelled(
    surface: SurfaceMap, tool: InfluenceFunction, machine: MachineDescription, asked: int
) -> None:
    calls = 0

    def cancelled() -> bool:
        nonlocal calls
        calls += 1
        return calls > asked

    with pytest.raises(CancelledError):
        make_plan(surface, tool, machine, OPTIONS, cancelled=cancelled)
    assert calls == asked + 1


@pytest.mark.parametrize(
    "choice",
    [{"path": "raster"}, {"path": "maze"}, {"trade_off": True}, {"l_curve": True}, {"v_min_mm_s": 1.0}],
    ids=lambda choice: next(iter(choice)) if "path" not in choice else choice["path"],
)
def test_whoever_cancels_is_heard_within_a_second(
    tool: InfluenceFunction, machine: MachineDescription, choice: dict[str, object]
) -> None:
    y, x = np.mgrid[-1:1:150j, -1:1:200j]
    surface = SurfaceMap.centred(30 * (x**2 + y**2) + 5 * np.sin(9 * x * y), 0.1)
    asked_s = [time.process_time()]

    def listen() -> bool:
        asked_s.append(time.process_time())
        return False

    options = PlanOptions(pitch_mm=0.3, step_mm=0.3, **choice)  # type: ignore[arg-type]
    plan = make_plan(surface, tool, machine, options, cancelled=listen)
    asked_s.append(time.process_time())
    assert plan.path.segments > 5000
    assert np.diff(asked_s).max() < 1.0


BAD = {
    "pitch of zero": (replace(OPTIONS, pitch_mm=0.0), "pitch"),
    "pitch that is none": (replace(OPTIONS, pitch_mm=float("nan")), "pitch"),
    "negative step": (replace(OPTIONS, step_mm=-1.0), "step"),
    "corridor of zero": (replace(OPTIONS, corridor_mm=0.0), "corridor"),
    "corridor that is none": (replace(OPTIONS, corridor_mm=float("nan")), "corridor"),
    "negative dwell": (replace(OPTIONS, dwell_min_s=-1.0), "dwell"),
    "dwell without end": (replace(OPTIONS, dwell_min_s=float("inf")), "dwell"),
    "dwell that is none": (replace(OPTIONS, dwell_min_s=float("nan")), "dwell"),
    "empty aperture": (replace(OPTIONS, clear_aperture=Rectangle(50, 60, 0, 1)), "clear aperture"),
    "aperture inside out": (replace(OPTIONS, clear_aperture=Rectangle(3, -3, 0, 1)), "clear aperture"),
    "nodes that are not there": (replace(OPTIONS, path=Path("absent.csv")), "absent.csv"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_choice_is_one_clear_line(
    surface: SurfaceMap, tool: InfluenceFunction, machine: MachineDescription, case: str
) -> None:
    options, said = BAD[case]
    with pytest.raises(InputError, match=said) as caught:
        make_plan(surface, tool, machine, options)
    assert "\n" not in str(caught.value)
    assert caught.value.hint


def test_a_tool_larger_than_the_map(surface: SurfaceMap, machine: MachineDescription) -> None:
    with pytest.raises(InputError, match="larger than the map"):
        make_plan(surface, gaussian(10.0, 1.0, 12.5, 0.25), machine, OPTIONS)


def test_a_path_that_leaves_the_travel(
    surface: SurfaceMap, tool: InfluenceFunction, machine: MachineDescription
) -> None:
    axis = machine.axes["A"].model_copy(update={"travel_max_mm": 7.0})
    short = machine.model_copy(update={"axes": {**machine.axes, "A": axis}})
    with pytest.raises(LimitsError, match="travel of axis A"):
        make_plan(surface, tool, short, OPTIONS)


def test_heights_in_the_wrong_unit_are_refused_before_the_memory_is_full(
    surface: SurfaceMap, tool: InfluenceFunction, machine: MachineDescription
) -> None:
    with pytest.raises(LimitsError, match="dwell time"):
        make_plan(SurfaceMap.centred(1e9 * surface.height_nm, 0.25), tool, machine, replace(OPTIONS, loop=False))


def test_a_mere_schedule_has_no_prediction_and_keeps_the_times(machine: MachineDescription) -> None:
    x_mm, y_mm = np.array([0.0, 1.0, 2.0, 2.0]), np.array([0.0, 0.0, 0.0, 1.0])
    plan = schedule_nodes(x_mm, y_mm, np.array([0.0, 0.5, 0.25, 3.0]), machine)
    assert plan.prediction is None
    assert plan.certificate.passed
    assert plan.program.total_time_s == 3.75
    assert "initial_rms_nm" not in plan.summary()
    assert set(plan.summary()) >= {"total_time_s", "nodes", "segments", "certificate", "planning_time_s"}
    with pytest.raises(InputError, match="holds no map"):
        as_run_figures(plan, x_mm, y_mm, 1 / 1024)


@pytest.mark.parametrize(
    ("x_mm", "dwell_s", "error", "said"),
    [
        ([0.0, 1.0], [0.5, 0.5], InputError, "first node is 0.5"),
        ([0.0, 1.0], [float("nan"), 0.5], InputError, "first node"),
        ([0.0, 1.0], [0.0], InputError, "2 nodes but 1 dwell times"),
        ([0.0], [0.0], InputError, "at least two nodes"),
        ([0.0, 1.0], [0.0, -0.5], LimitsError, "node 1"),
        ([0.0, 1.0], [0.0, 0.001], LimitsError, r"node 1 \(1\.000, 0\.000 mm\) \+"),
        ([0.0, 1.0], [0.0, 1e12], LimitsError, "node 1"),
        ([0.0, 400.0], [0.0, 100.0], LimitsError, "travel of axis A"),
    ],
)
def test_a_schedule_that_cannot_be_is_one_clear_line(
    machine: MachineDescription, x_mm: list[float], dwell_s: list[float], error: type[Exception], said: str
) -> None:
    with pytest.raises(error, match=said) as caught:
        schedule_nodes(np.array(x_mm), np.zeros(len(x_mm)), np.array(dwell_s), machine)
    assert "\n" not in str(caught.value)


def test_as_run_figures_need_an_open_gate(plan: Plan) -> None:
    with pytest.raises(InputError, match="never open"):
        as_run_figures(plan, np.zeros(0), np.zeros(0), 1 / 1024)
