"""Who may ask for what: by keys and roles; without keys this computer alone."""

import shutil
import ssl
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from ibfctl.service.keys import KeyRing, Role
from ibfctl.service.settings import Settings
from tests.support.served import serving
from tests.support.small_job import TIF

FORMULA = {"formula": TIF}


@pytest.fixture
def tokens(settings: Settings) -> dict[str, str]:
    ring = KeyRing(settings.data)
    return {role.name.lower(): ring.add(role.name.lower(), role)[1] for role in Role}


@pytest.fixture
def guarded(tokens: dict[str, str], settings: Settings) -> Iterator[httpx.Client]:
    with serving(settings) as client:
        yield client


def _by(token: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {token}"}


def test_without_a_valid_key_only_health_and_description_answer(guarded: httpx.Client) -> None:
    for headers in ({}, _by("ibf_12345678_guess"), {"Authorization": "Basic eDp5"}):
        refusal = guarded.get("/v1/info", headers=headers)
        assert (refusal.status_code, refusal.json()["code"]) == (401, "unauthorized")
        assert refusal.headers["www-authenticate"] == "Bearer"
    assert guarded.get("/healthz").status_code == 200
    assert guarded.get("/openapi.json").status_code == 200


def test_a_role_may_what_it_says(guarded: httpx.Client, tokens: dict[str, str]) -> None:
    for role, makes in (("view", 403), ("operate", 201), ("admin", 201)):
        assert guarded.get("/v1/influences", headers=_by(tokens[role])).status_code == 200
        made = guarded.post("/v1/influences", params=FORMULA, headers=_by(tokens[role]))
        assert made.status_code == makes
    refusal = guarded.delete("/v1/influences/0123456789abcdef", headers=_by(tokens["view"]))
    assert (refusal.status_code, refusal.json()["code"]) == (403, "forbidden")


def test_every_key_may_abort(guarded: httpx.Client, tokens: dict[str, str]) -> None:
    for token in tokens.values():  # it does not exist, but the key may ask
        assert guarded.post("/v1/runs/0123456789abcdef/abort", headers=_by(token)).status_code == 404


def test_with_keys_the_name_of_the_host_does_not_matter(guarded: httpx.Client, tokens: dict[str, str]) -> None:
    elsewhere = {"Host": "ibf.example.org", **_by(tokens["view"])}
    assert guarded.get("/v1/info", headers=elsewhere).status_code == 200


def test_a_removed_key_is_refused_at_once(guarded: httpx.Client, tokens: dict[str, str], settings: Settings) -> None:
    KeyRing(settings.data).remove("operate")
    assert guarded.get("/v1/info", headers=_by(tokens["operate"])).status_code == 401


def _serve(*options: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "ibfctl", "serve", *options]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)


def test_other_computers_are_served_only_with_keys(tmp_path: Path) -> None:
    refused = _serve("--simulate", "--host", "0.0.0.0", "--data", str(tmp_path))
    assert refused.returncode == 2
    assert "there are no keys" in refused.stderr


def test_a_configuration_file_that_does_not_fit_is_refused(tmp_path: Path) -> None:
    config = tmp_path / "service.toml"
    for text, place in (("sped = 2", "sped"), ("port = -1", "port"), ('tls_key = "k"', "tls_key"), ("=", "cannot")):
        config.write_text(text)
        refused = _serve("--config", str(config))
        assert refused.returncode == 2
        assert refused.stderr.startswith("error: config")
        assert place in refused.stderr
    config.write_text("")
    assert "no machine is given" in _serve("--config", str(config)).stderr


@pytest.mark.skipif(shutil.which("openssl") is None, reason="needs openssl to make a certificate")
def test_https_by_certificate_and_configuration_file(tmp_path: Path) -> None:
    make = "openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days 1 -subj /CN=127.0.0.1"
    names = ["-addext", "subjectAltName=IP:127.0.0.1", "-keyout", "key.pem", "-out", "cert.pem"]
    subprocess.run([*make.split(), *names], cwd=tmp_path, check=True, capture_output=True)
    config = tmp_path / "service.toml"
    config.write_text(
        'simulate = true\nport = 0\ndata = "data"\ntls_certificate = "cert.pem"\ntls_key = "key.pem"\n'
        "max_upload_bytes = 10\n"
    )
    command = [sys.executable, "-m", "ibfctl", "serve", "--config", str(config)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, cwd="/") as process:
        try:
            assert process.stderr is not None
            said = process.stderr.readline()
            assert str(tmp_path / "data") in said
            address = said.split()[2].rstrip(",")
            assert address.startswith("https://")
            trust = ssl.create_default_context(cafile=str(tmp_path / "cert.pem"))
            with httpx.Client(base_url=address, verify=trust, timeout=30) as client:
                assert client.get("/healthz").status_code == 200
                refusal = client.post("/v1/maps", params={"format": "npz"}, content=bytes(11))
                assert refusal.status_code == 413
        finally:
            process.terminate()
