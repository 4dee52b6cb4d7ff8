"""Choices about residual, time and regularisation in the body of a plan."""

import io

import httpx
import numpy as np
import pytest

from tests.support.served import ended
from tests.support.small_job import TIF, SmallJob, small_height_nm


def test_a_plan_takes_the_choices_of_the_command_line(served: httpx.Client, small_job: SmallJob) -> None:
    surface = served.post("/v1/maps", params={"format": "npz"}, content=small_job.map.read_bytes()).json()
    influence = served.post("/v1/influences", params={"formula": TIF}).json()
    request = {"map_id": surface["id"], "influence_id": influence["id"], "pitch_mm": 1.0, "step_mm": 1.0}
    bounds = {"v_min_mm_s": 0.5, "dwell_bounds": "machine"}
    choices = bounds | {"margin": 0.2, "l_curve": True, "trade_off": True, "loop": False}
    choices |= {"corner_tolerance_mm": 0.05}
    plan = ended(served, served.post("/v1/plans", json=request | choices).headers["Location"])
    assert plan["state"] == "done", plan
    (chosen,) = (point for point in plan["summary"]["trade_off"] if point["chosen"])
    assert plan["summary"]["dwell_bounds"]["longest_s"] == 2.0
    assert plan["summary"]["smoothing"]["corner_tolerance_mm"] == 0.05
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


def test_a_mask_is_a_map_of_its_own(served: httpx.Client) -> None:
    influence = served.post("/v1/influences", params={"formula": TIF}).json()
    inside = np.ones((32, 48))
    inside[:, 30:] = np.nan
    maps = []
    for height_nm in (small_height_nm(), inside, inside[:20]):
        content = io.BytesIO()
        np.savez(content, height_nm=height_nm, pixel_mm=0.25)
        maps.append(served.post("/v1/maps", params={"format": "npz"}, content=content.getvalue()).json()["id"])
    request = {"map_id": maps[0], "influence_id": influence["id"], "pitch_mm": 1.0, "step_mm": 1.0, "loop": False}
    whole, masked, misfit = (
        ended(served, served.post("/v1/plans", json=request | {"clear_aperture_mm": aperture}).headers["Location"])
        for aperture in (None, {"mask_id": maps[1]}, {"mask_id": maps[2]})
    )
    assert masked["state"] == "done", masked
    assert masked["summary"]["segments"] < 0.8 * whole["summary"]["segments"]
    assert misfit["state"] == "failed"
    assert "shape (20, 48)" in misfit["error"]["detail"]
    assert served.post("/v1/plans", json=request | {"clear_aperture_mm": {"mask_id": "x"}}).status_code == 404


@pytest.mark.parametrize(
    "placement",
    [
        {"offset_mm": [10, -5], "rotation_deg": 90, "mirrored": True},
        {"fiducials_mm": [[-6, 0, 10, 1], [6, 0, 10, -11], [0, 4, 6, -5]], "mirrored": True},
    ],
)
def test_a_plan_takes_how_the_part_stands(
    served: httpx.Client, small_job: SmallJob, placement: dict[str, object]
) -> None:
    surface = served.post("/v1/maps", params={"format": "npz"}, content=small_job.map.read_bytes()).json()
    influence = served.post("/v1/influences", params={"formula": TIF}).json()
    request = {"map_id": surface["id"], "influence_id": influence["id"], "pitch_mm": 1.0, "step_mm": 1.0, "loop": False}
    plan = ended(served, served.post("/v1/plans", json=request | {"placement": placement}).headers["Location"])
    assert plan["state"] == "done", plan
    found = plan["summary"]["placement"]
    stands = found["offset_x_mm"], found["offset_y_mm"], found["rotation_deg"], found["mirrored"]
    assert stands == pytest.approx((10, -5, 90, True))


@pytest.mark.parametrize(
    "placement", [{"rotation_deg": "a"}, {"fiducials_mm": [[0, 0, 1, 1]]}, {"offset_mm": [0, 0], "scale": 2}]
)
def test_what_is_no_placement_is_refused(served: httpx.Client, placement: dict[str, object]) -> None:
    answer = served.post("/v1/plans", json={"map_id": "x", "influence_id": "y", "placement": placement})
    assert answer.status_code == 422
    assert "placement" in answer.json()["detail"]


def test_a_factor_out_of_range_is_refused(served: httpx.Client) -> None:
    body = {"map_id": "x", "influence_id": "y", "tikhonov": 2.0}
    answer = served.post("/v1/plans", json=body)
    assert answer.status_code == 422
    assert "tikhonov" in answer.json()["detail"]


@pytest.mark.parametrize(
    ("choices", "said"),
    [
        ({}, "either influence_id or tools"),
        ({"influence_id": "y", "tools": [{"influence_id": "y"}]}, "either influence_id or tools"),
        ({"tools": []}, "tools"),
        ({"tools": [{"influence_id": "y"}], "trade_off": True}, "for one tool"),
        ({"tools": [{"influence_id": "y", "pitch_mm": 0}]}, "tools.0.pitch_mm"),
        ({"influence_id": "y", "margin": 0.1, "seconds_per_nm": 3}, "exclude each other"),
    ],
)
def test_what_names_no_tool_or_contradicts_itself_is_refused(
    client: httpx.Client, choices: dict[str, object], said: str
) -> None:
    answer = client.post("/v1/plans", json={"map_id": "x", **choices})
    assert answer.status_code == 422
    assert said in answer.json()["detail"]
