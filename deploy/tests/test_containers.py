"""What can be known of containers without running one: settings, the health check, the keys, the context."""

from __future__ import annotations

import fnmatch
import os
import pathlib
import re
import stat
import subprocess

import orenx
import pytest
import yaml
from servers import ROOT, binary, free_port, start

DEPLOY = ROOT / "deploy"
KINDS = ("ingest", "read", "admin")


def known_settings() -> set[str]:
    """Every setting as a variable of the environment, of deploy/orenx.toml."""
    known, section = {"ORENX_LOG"}, ""
    for line in (DEPLOY / "orenx.toml").read_text().splitlines():
        if head := re.fullmatch(r"\[(\w+)\]", line):
            section = head[1]
        elif key := re.match(r"(?:# )?(\w+) = ", line):
            known.add(f"ORENX_{section}_{key[1]}".upper())
    return known


def variables() -> list[tuple[str, str]]:
    """The settings that files of deploy/ give in the environment."""
    found = []
    for name in ("compose.yaml", "compose.gpu.yaml"):
        compose = yaml.safe_load((DEPLOY / "docker" / name).read_text())
        found += [(name, key) for key in compose["services"]["orenx"]["environment"]]
    found += [("unit", key) for key in re.findall(r"^Environment=(\w+)=", unit(), re.M)]
    patch = yaml.safe_load((DEPLOY / "kubernetes/gpu/gpu.yaml").read_text())
    (container,) = patch["spec"]["template"]["spec"]["containers"]
    found += [("gpu.yaml", variable["name"]) for variable in container["env"]]
    return found


def unit() -> str:
    return (DEPLOY / "systemd/orenx.service").read_text()


@pytest.mark.parametrize(("file", "variable"), variables())
def test_settings_of_the_environment_exist(file, variable):
    assert variable in known_settings(), file


def test_a_setting_that_does_not_exist_would_be_found():
    assert "ORENX_SERVER_GRPC" in known_settings()
    assert "ORENX_SERVER_GRPCS" not in known_settings()


def test_kubernetes_has_the_settings_of_any_container():
    def without_comments(path: pathlib.Path) -> list[str]:
        return [line for line in path.read_text().splitlines() if line and not line.startswith("#")]

    docker, kubernetes = DEPLOY / "docker/orenx.toml", DEPLOY / "kubernetes/base/orenx.toml"
    assert without_comments(docker) == without_comments(kubernetes)


def test_the_health_check_says_whether_questions_are_answered():
    check = DEPLOY / "docker/healthcheck"
    server = start()
    port = server.http.rsplit(":", 1)[1]
    try:
        assert subprocess.run([check, port], check=False).returncode == 0
    finally:
        server.stop()
    gone = subprocess.run([check, str(free_port())], check=False, capture_output=True)
    assert gone.returncode != 0


@pytest.fixture
def keys(tmp_path) -> pathlib.Path:
    subprocess.run([DEPLOY / "docker/keys", tmp_path / "keys"], check=True, capture_output=True)
    return tmp_path / "keys"


def test_keys_are_made_once_and_kept_from_others(keys):
    made = {kind: (keys / f"orenx_{kind}_key").read_text() for kind in KINDS}
    assert len(set(made.values())) == 3
    assert all(re.fullmatch("[0-9a-f]{64}", key) for key in made.values())
    assert stat.S_IMODE(keys.stat().st_mode) == 0o700
    subprocess.run([DEPLOY / "docker/keys", keys], check=True)
    assert {kind: (keys / f"orenx_{kind}_key").read_text() for kind in KINDS} == made


def test_the_container_s_settings_let_in_who_has_a_key(keys, tmp_path):
    """The file as it is, but for its folders and ports."""
    text = (DEPLOY / "docker/orenx.toml").read_text().replace("/run/secrets", str(keys))
    (tmp_path / "orenx.toml").write_text(text)
    server = start(config=tmp_path / "orenx.toml")
    try:
        admin = (keys / "orenx_admin_key").read_text()
        with orenx.connect(server.grpc, api_key=admin) as client:
            assert client.map("default").info().map.map_id == "default"
        with orenx.connect(server.grpc) as client, pytest.raises(orenx.UnauthenticatedError):
            client.map("default").info()
        reader = (keys / "orenx_read_key").read_text()
        with orenx.connect(server.grpc, api_key=reader) as client:
            client.map("default").query_points([[0, 0, 0]])
            with pytest.raises(orenx.PermissionDeniedError):
                client.map("default").reset()
        port = server.http.rsplit(":", 1)[1]
        assert subprocess.run([DEPLOY / "docker/healthcheck", port], check=False).returncode == 0
    finally:
        server.stop()


def test_without_its_keys_the_container_does_not_start(tmp_path):
    text = (
        (DEPLOY / "docker/orenx.toml").read_text().replace("/run/secrets", str(tmp_path / "none"))
    )
    (tmp_path / "orenx.toml").write_text(text.replace("7610", "0").replace("7611", "0"))
    env = {key: value for key, value in os.environ.items() if not key.startswith("ORENX_")}
    command = [binary(), "serve", "--config", tmp_path / "orenx.toml", "--set", "storage.path="]
    done = subprocess.run(command, env=env, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2, done.stderr
    assert "key_file" in done.stderr


def kept(path: str, rules: list[str]) -> bool:
    """Whether a file is sent to the builder: the last rule that names it or a folder above it decides."""
    answer = True
    for rule in rules:
        pattern = rule.lstrip("!").removeprefix("**/")
        parts = path.split("/")
        above = ["/".join(parts[: i + 1]) for i in range(len(parts))]
        candidates = above + (parts if rule.lstrip("!").startswith("**/") else [])
        if any(fnmatch.fnmatchcase(candidate, pattern) for candidate in candidates):
            answer = rule.startswith("!")
    return answer


def test_the_builder_gets_what_it_compiles_and_nothing_else():
    lines = (ROOT / ".dockerignore").read_text().splitlines()
    rules = [line for line in lines if line and not line.startswith("#")]
    copied = re.findall(r"^COPY (deploy\S+)", (DEPLOY / "docker/Dockerfile").read_text(), re.M)
    needed = [
        *copied,
        "Cargo.toml",
        "Cargo.lock",
        "src/main.rs",
        "proto/build.rs",
        "proto/orenx/v1/query.proto",
        "deploy/orenx.toml",
        *(str(path.relative_to(ROOT)) for path in ROOT.glob("clients/web/build/*")),
        *re.findall(r'^path = "(.*)"', (ROOT / "Cargo.toml").read_text(), re.M),
    ]
    for source in (ROOT / "src").rglob("*.rs"):
        production = source.read_text().split("#[cfg(test)]")[0]
        included = re.findall(r'include_(?:str|bytes)!\("([^"]+)"\)', production)
        needed += [os.path.relpath(source.parent / named, ROOT) for named in included]
    for path in needed:
        assert kept(path, rules), path
    for path in (
        ".git/config",
        "target/release/orenx",
        ".venv/bin/python",
        "deploy/docker/secrets/orenx_admin_key",
    ):
        assert not kept(path, rules), path
