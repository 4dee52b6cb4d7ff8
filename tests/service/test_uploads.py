"""Uploads as the raw body or as a form, and their limits."""

import dataclasses
from pathlib import Path

import httpx
import numpy as np
import pytest

from ibfctl.service.settings import Settings
from tests.support.map_files import hill_nm, write_datx, write_mat73, write_metropro, write_tiff
from tests.support.served import serving
from tests.support.small_job import SmallJob

NPZ = {"format": "npz"}
BOUNDARY = "multipart/form-data; boundary=x"


def test_a_form_is_the_same_as_the_raw_body(client: httpx.Client, small_job: SmallJob) -> None:
    content = small_job.map.read_bytes()
    raw = client.post("/v1/maps", params=NPZ, content=content).json()
    files = {"file": ("C:\\..\\map.npz", content, "application/octet-stream")}
    form = client.post("/v1/maps", params=NPZ, files=files, data={"note": "ignored"})
    assert form.status_code == 201
    assert form.json()["sha256"] == raw["sha256"]


@pytest.mark.parametrize(
    "body",
    [
        "--x\r\nContent-Disposition: form-data; name=a\r\n\r\n1\r\n--x--\r\n",
        "--x\r\nContent-Disposition: form-data; name=a; filename=b\r\n\r\n1",
        "--x\r\nContent-Disposition: form-data; name=a; filename=b\r\n\r\n1\r\n" * 2 + "--x--\r\n",
        "no form at all",
    ],
    ids=["no file", "cut off", "two files", "no form"],
)
def test_a_form_without_exactly_one_file_is_refused(client: httpx.Client, body: str) -> None:
    refusal = client.post("/v1/maps", params=NPZ, content=body, headers={"Content-Type": BOUNDARY})
    assert (refusal.status_code, refusal.json()["code"]) == (422, "bad_request")
    assert client.get("/v1/maps").json()["items"] == []


def test_files_of_instruments_and_what_is_left_of_them(client: httpx.Client, tmp_path: Path) -> None:
    written: dict[str, tuple[Path, dict[str, object]]] = {
        "dat": (write_metropro(tmp_path / "m.dat", hill_nm()), {}),
        "datx": (write_datx(tmp_path / "m.datx", hill_nm()), {}),
        "tif": (write_tiff(tmp_path / "m.tif", hill_nm()), {"pixel_mm": 0.5, "unit": "nm"}),
        "mat": (write_mat73(tmp_path / "m.mat", Z=hill_nm() * 1e-9), {"pixel_mm": 0.5}),
    }
    for form, (path, given) in written.items():
        content = path.read_bytes()
        made = client.post("/v1/maps", params={"format": form, **given}, content=content)
        assert made.status_code == 201, made.text
        figures = made.json()["figures"]
        assert (figures["nx"], figures["ny"], figures["valid_pixels"]) == (7, 5, 33)
        assert figures["pv_nm"] == pytest.approx(np.nanmax(hill_nm()) - np.nanmin(hill_nm()), abs=0.01)
        refusal = client.post("/v1/maps", params={"format": form, **given}, content=content[: len(content) // 3])
        assert (refusal.status_code, refusal.json()["code"]) == (422, "bad_input")


def test_maps_beyond_the_limit_are_refused(settings: Settings, small_job: SmallJob) -> None:
    with serving(dataclasses.replace(settings, max_map_pixels=100)) as client:
        refusal = client.post("/v1/maps", params=NPZ, content=small_job.map.read_bytes())
        assert (refusal.status_code, refusal.json()["code"]) == (422, "bad_input")
        assert "48 x 32 pixels" in refusal.json()["detail"]
        fine = "gaussian:fwhm_mm=1.6,peak_nm_s=4,radius_mm=2"
        refusal = client.post("/v1/influences", params={"formula": fine, "pixel_mm": 0.01})
        assert (refusal.status_code, refusal.json()["code"]) == (422, "bad_input")


def test_what_no_memory_holds_is_refused(client: httpx.Client) -> None:
    endless = {"formula": "gaussian:fwhm_mm=1.6,peak_nm_s=4,radius_mm=2000", "pixel_mm": 0.05}
    refusal = client.post("/v1/influences", params=endless)
    assert (refusal.status_code, refusal.json()["code"]) == (422, "bad_input")


def test_machines_are_resources(client: httpx.Client, small_job: SmallJob) -> None:
    text = small_job.machine.read_text().replace('name = "simulator"', 'name = "the other one"')
    made = client.post("/v1/machines", content=text)
    assert made.status_code == 201
    machine = made.json()
    assert machine["machine"]["name"] == "the other one"
    assert machine["machine"]["axes"]["A"]["v_max_mm_s"] == 250.0
    assert client.get(machine["links"]["self"]).json() == machine
    assert client.get(machine["links"]["machine.toml"]).text == text
    assert client.get("/v1/machines").json()["items"][0]["id"] == machine["id"]
    for wrong in (text.replace("v_max_mm_s", "v_mx"), "=", b"\xff"):
        refusal = client.post("/v1/machines", content=wrong)
        assert (refusal.status_code, refusal.json()["code"]) == (422, "bad_input")
    assert client.delete(machine["links"]["self"]).status_code == 204
    assert client.get(machine["links"]["self"]).status_code == 404


def test_the_service_shows_its_figures_and_describes_itself(client: httpx.Client) -> None:
    assert client.get("/readyz").json() == {"status": "ok"}
    client.get("/v1/maps/absent")
    lines = client.get("/metrics").text.splitlines()
    assert 'ibfctl_requests_total{method="GET",status="404"} 1' in lines
    assert "ibfctl_plans_under_way 0" in lines
    page = client.get("/docs").text
    assert "https:" not in page
    assert "http:" not in page
