"""``scripts/docker`` against the program: the tests do not build the image, but check its parts."""

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

from graspbox.tools.remote import EnvironmentServer, ServerSettings

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "scripts/docker"
TLS = ROOT / "tests/fixtures/tls"


def instructions() -> list[tuple[str, str]]:
    """Instructions of the Dockerfile, each in one line."""
    text = (FOLDER / "Dockerfile").read_text()
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    joined = re.sub(r"\\\n\s*", "", "\n".join(lines)).splitlines()
    return [(line.partition(" ")[0], line.partition(" ")[2]) for line in joined]


def last(name: str) -> str:
    return [value for other, value in instructions() if other == name][-1]


def health() -> list[str]:
    """Command of the health check, with the interpreter of the tests."""
    command: list[str] = json.loads(last("HEALTHCHECK").partition("CMD ")[2])
    assert command[0] == "python"
    return [sys.executable, *command[1:]]


def manifests() -> dict[str, Any]:
    return {one["kind"]: one for one in yaml.safe_load_all((FOLDER / "kubernetes.yaml").read_text())}


def pod() -> tuple[dict[str, Any], dict[str, Any]]:
    """Find the pod of the Deployment, and its container."""
    spec = manifests()["Deployment"]["spec"]["template"]["spec"]
    return spec, spec["containers"][0]


def serve(*options: str) -> "subprocess.Popen[str]":
    """Run the entry point of the image with options, at a port that is free."""
    entry = json.loads(last("ENTRYPOINT"))
    assert entry == ["graspbox", "serve"]
    call = [sys.executable, "-m", *entry, *options, "--port", "0"]
    return subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_the_image_is_built_of_what_is_there() -> None:
    ignored = (FOLDER / "Dockerfile.dockerignore").read_text().splitlines()
    for path in ("Cargo.lock", "pyproject.toml", "README.md", "LICENSE", "env", "tests/Cargo.toml", "python"):
        assert f"!{path}" in ignored
    for line in ignored:
        if line.startswith("!"):
            assert (ROOT / line[1:]).exists(), line
    for name, value in instructions():
        if name == "COPY" and "--from" not in value and value != ". .":
            assert (ROOT / value.split()[0]).exists(), value
    assert "dist" in tomllib.loads((ROOT / "Cargo.toml").read_text())["profile"]
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    install = next(
        value for name, value in instructions() if name == "RUN" and "pip install" in value and "}[" in value
    )
    assert set(re.findall(r"\}\[(.*?)\]", install)[0].split(",")) <= set(extras)


def test_the_image_does_not_run_as_root() -> None:
    user = last("USER")
    assert user == "10001"
    assert any(f"--uid {user} " in value for name, value in instructions() if name == "RUN")
    assert str(pod()[0]["securityContext"]["runAsUser"]) == user


def test_as_it_stands_the_image_lets_nobody_in() -> None:
    """Beyond the container, and without certificate and token, the server does not start."""
    with serve(*json.loads(last("CMD"))) as process:
        _, error = process.communicate(timeout=60)
        assert process.returncode == 2
        assert "--insecure" in error


@pytest.mark.parametrize("draining", [False, True])
def test_the_health_check_asks_the_server(draining: bool) -> None:
    assert f":{ServerSettings().port}/healthz" in last("ENV")
    with EnvironmentServer(ServerSettings(port=0)) as server:
        if draining:
            server.drain()
        variables = {"GRASPBOX_HEALTH": server.url.replace("ws", "http", 1) + "/healthz"}
        found = subprocess.run(health(), env={**os.environ, **variables}, capture_output=True)
        assert found.returncode == int(draining)


def test_the_deployment_starts_a_server(tmp_path: Path) -> None:
    """Its arguments, with the files that its volumes would hold; the health check passes over TLS."""
    (tmp_path / "token").write_text("a-token-of-some-length\n")
    files = {
        "/run/graspbox/token/token": tmp_path / "token",
        "/run/graspbox/tls/tls.crt": TLS / "server.pem",
        "/run/graspbox/tls/tls.key": TLS / "server.key",
    }
    _, container = pod()
    options = []
    for argument in container["args"]:
        name, _, value = argument.partition("=")
        if name not in ("--port", "--host") and value != "ycb":
            options += [name, str(files.get(value, value))]
    with serve(*options) as process:
        try:
            assert process.stdout is not None
            url = re.search(r"wss://\S+", process.stdout.readline())
            assert url is not None
            variables = {"GRASPBOX_HEALTH": url[0].replace("wss", "https", 1) + "/healthz"}
            subprocess.run(health(), env={**os.environ, **variables}, check=True)
        finally:
            process.terminate()
        assert process.wait(timeout=20) == 0


def test_ports_mounts_and_probes_of_the_deployment_fit_together() -> None:
    spec, container = pod()
    port = container["ports"][0]
    assert f"--port={port['containerPort']}" in container["args"]
    assert str(port["containerPort"]) == last("EXPOSE") == str(ServerSettings().port)
    for probe in ("readinessProbe", "startupProbe"):
        asked = container[probe]["httpGet"]
        assert (asked["path"], asked["port"], asked["scheme"]) == ("/healthz", port["name"], "HTTPS")
    assert container["livenessProbe"]["tcpSocket"]["port"] == port["name"]
    mounts = {one["name"]: one["mountPath"] for one in container["volumeMounts"]}
    assert set(mounts) == {volume["name"] for volume in spec["volumes"]}
    for argument in container["args"]:
        _, _, path = argument.partition("=")
        if path.startswith("/"):
            assert str(Path(path).parent) in mounts.values()
    assert any(value == f"GRASPBOX_CACHE={mounts['cache']}" for name, value in instructions() if name == "ENV")
    found = manifests()
    labels = found["Deployment"]["spec"]["template"]["metadata"]["labels"]
    assert found["Service"]["spec"]["selector"] == found["Deployment"]["spec"]["selector"]["matchLabels"] == labels
    assert found["Service"]["spec"]["ports"][0]["targetPort"] == port["name"]
    read = (FOLDER / "README.md").read_text()
    for volume in ("token", "tls"):
        name = next(one["secret"]["secretName"] for one in spec["volumes"] if one["name"] == volume)
        assert re.search(rf"create secret \w+ {name} ", read)
    # The server waits 10 s for running calls.
    assert spec["terminationGracePeriodSeconds"] > 10
