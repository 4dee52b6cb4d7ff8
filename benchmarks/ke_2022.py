"""The set-ups of Ke et al. 2022 by ours, MTO and STO: residual, time and smoothness, what the speed limit costs."""

from __future__ import annotations

from typing import Any

from benchmarks._tools import EXPERIMENT, SIMULATION, slopes_s_mm
from ibfctl.planning.options import Aim
from ibfctl.planning.sequence import PlanSequence

PIXEL_MM = {"simulation": 0.5, "experiment": 0.25}


def run() -> dict[str, Any]:
    """Plan both set-ups in every way; the paper's maps are not public, so only the order of its figures compares."""
    simulated, polished = SIMULATION.surface(PIXEL_MM["simulation"]), EXPERIMENT.surface(PIXEL_MM["experiment"])
    sequential = SIMULATION.plan(simulated, "sto")
    as_good = Aim(max_residual_nm=float(sequential.summary()["ideal_rms_nm"]))  # type: ignore[arg-type]
    planned = {
        "simulation_ours": SIMULATION.plan(simulated, "ours"),
        "simulation_ours_as_good_as_sto": SIMULATION.plan(simulated, "ours", as_good),
        "simulation_mto": SIMULATION.plan(simulated, "mto"),
        "simulation_sto": sequential,
        "experiment_ours": EXPERIMENT.plan(polished, "ours"),
        "experiment_ours_no_loop": EXPERIMENT.plan(polished, "ours", loop=False),
        "experiment_mto": EXPERIMENT.plan(polished, "mto"),
        "experiment_mto_unlimited": EXPERIMENT.plan(polished, "mto", limited=False),
        "experiment_sto": EXPERIMENT.plan(polished, "sto"),
    }
    metrics: dict[str, float] = {}
    for name, sequence in planned.items():
        metrics |= {f"{name}_{figure}": value for figure, value in _figures(sequence).items()}
    return {
        "metrics": metrics,
        "targets": {
            "simulation_mto_time_min": {"max": 0.4 * metrics["simulation_sto_time_min"]},
            "simulation_mto_ideal_rms_nm": {
                "min": metrics["simulation_sto_ideal_rms_nm"],
                "max": 1.1 * metrics["simulation_sto_ideal_rms_nm"],
            },
            "simulation_ours_as_good_as_sto_time_min": {"max": 0.8 * metrics["simulation_mto_time_min"]},
            "simulation_ours_as_good_as_sto_executed_rms_nm": {"max": metrics["simulation_sto_ideal_rms_nm"]},
            "simulation_ours_executed_rms_nm": {"max": metrics["simulation_sto_executed_rms_nm"]},
            **{
                f"simulation_{method}_tool_{number}_slope_s_mm": {
                    "max": metrics[f"simulation_{than}_tool_{number}_slope_s_mm"]
                }
                for method, than in (("mto", "sto"), ("ours_as_good_as_sto", "mto"))
                for number in (1, 2, 3)
            },
            "experiment_mto_unlimited_ideal_rms_nm": {"max": metrics["experiment_mto_ideal_rms_nm"]},
            "experiment_ours_executed_rms_nm": {"max": metrics["experiment_ours_no_loop_executed_rms_nm"]},
        },
        "peers": {
            "paper_simulation_mto_time_min": 491.16,
            "paper_simulation_sto_time_min": 2794.33,
            "paper_simulation_sto_ideal_rms_nm": 0.71,
            "paper_experiment_mto_ideal_rms_nm": 6.93,
            "paper_experiment_mto_unlimited_ideal_rms_nm": 2.1,
            "paper_experiment_mto_time_min": 13.28,
        },
    }


def _figures(sequence: PlanSequence) -> dict[str, float]:
    summary: dict[str, Any] = sequence.summary()
    figures = {
        "ideal_rms_nm": summary["ideal_rms_nm"],
        "executed_rms_nm": summary["executed_rms_nm"],
        "time_min": sequence.beam_time_s / 60,
    }
    for number, (plan, slope) in enumerate(zip(sequence.plans, slopes_s_mm(sequence), strict=True), 1):
        figures |= {f"tool_{number}_min": plan.program.total_time_s / 60, f"tool_{number}_slope_s_mm": slope}
    return figures
