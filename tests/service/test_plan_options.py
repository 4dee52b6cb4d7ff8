"""Choices about residual, time and regularisation in the body of a plan."""

import httpx
import pytest

from tests.support.served import ended
from tests.support.small_job import TIF, SmallJob


def test_a_plan_takes_the_choices_of_the_command_line(served: httpx.Client, small_job: SmallJob) -> None:
    surface = served.post("/v1/maps", params={"format": "npz"}, content=small_job.map.read_bytes()).json()
    influence = served.post("/v1/influences", params={"formula": TIF}).json()
    request = {"map_id": surface["id"], "influence_id": influence["id"], "pitch_mm": 1.0, "step_mm": 1.0}
    bounds = {"v_min_mm_s": 0.5, "dwell_bounds": "machine"}
    choices = bounds | {"margin": 0.2, "l_curve": True, "trade_off": True, "loop": False}
    plan = ended(served, served.post("/v1/plans", json=request | choices).headers["Location"])
    assert plan["state"] == "done", plan
    (chosen,) = (point for point in plan["summary"]["trade_off"] if point["chosen"])
    assert plan["summary"]["dwell_bounds"]["longest_s"] == 2.0
    assert chosen["rms_nm"] == pytest.approx(plan["summary"]["ideal_rms_nm"])


@pytest.mark.parametrize(
    "aperture", [[-3, 3, -2, 2], {"circle": [0, 0, 3]}, {"polygon": [[-3, 0], [0, -3], [3, 0], [0, 3]]}]
)
def test_a_plan_takes_every_shape_of_aperture(
    served: httpx.Client, small_job: SmallJob, aperture: list[float] | dict[str, list[float]]
) -> None:
    surface = served.post("/v1/maps", params={"format": "npz"}, content=small_job.map.read_bytes()).json()
    influence = served.post("/v1/influences", params={"formula": TIF}).json()
    request = {"map_id": surface["id"], "influence_id": influence["id"], "pitch_mm": 1.0, "step_mm": 1.0, "loop": False}
    plan = ended(served, served.post("/v1/plans", json=request | {"clear_aperture_mm": aperture}).headers["Location"])
    assert plan["state"] == "done", plan
    assert plan["request"]["clear_aperture_mm"] == aperture
    assert plan["summary"]["executed_rms_nm"] < 0.2 * plan["summary"]["initial_rms_nm"]


@pytest.mark.parametrize(
    "aperture", [{"circle": [0, 0, 0]}, {"polygon": [[0, 0], [1, 1]]}, {"disc": [0, 0, 1]}, [1, 2]]
)
def test_what_is_no_aperture_is_refused(served: httpx.Client, aperture: object) -> None:
    answer = served.post("/v1/plans", json={"map_id": "x", "influence_id": "y", "clear_aperture_mm": aperture})
    assert answer.status_code == 422
    assert "clear_aperture_mm" in answer.json()["detail"]


def test_a_factor_out_of_range_is_refused(served: httpx.Client) -> None:
    body = {"map_id": "x", "influence_id": "y", "tikhonov": 2.0}
    answer = served.post("/v1/plans", json=body)
    assert answer.status_code == 422
    assert "tikhonov" in answer.json()["detail"]
