"""Starts real servers: the program that ORENX_BIN names, on free ports."""

from __future__ import annotations

import dataclasses
import os
import pathlib
import re
import socket
import subprocess
import tempfile
import threading
from typing import IO

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[3]
# How long anything that is waited for may take.
PATIENCE_S = 60.0


def binary() -> pathlib.Path:
    path = pathlib.Path(os.environ.get("ORENX_BIN", ROOT / "target/release/orenx"))
    assert path.exists(), f"{path} is not there: cargo build --release, or set ORENX_BIN"
    return path


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@dataclasses.dataclass
class Server:
    grpc: str
    http: str
    zenoh: str
    process: subprocess.Popen[str]
    log: IO[str]

    def stop(self) -> None:
        self.process.terminate()
        try:
            self.process.wait(PATIENCE_S)
        finally:
            self.process.kill()
            self.process.wait()
            self.process.stdout.close()
            self.log.close()


def start(*settings: str, zenoh: bool = False, config: pathlib.Path | None = None) -> Server:
    """Starts a server that keeps nothing, and waits until it says where it is."""
    port = free_port()
    said = [
        "server.grpc=127.0.0.1:0",
        "server.http=127.0.0.1:0",
        "storage.path=",
        *([f"zenoh.listen=tcp/127.0.0.1:{port}", "zenoh.mode=router"] if zenoh else []),
        *settings,
    ]
    flags = [part for setting in said for part in ("--set", setting)]
    if config is not None:
        flags += ["--config", str(config)]
    # ORENX_… of the environment are settings to a server.
    env = {key: value for key, value in os.environ.items() if not key.startswith("ORENX_")}
    log = tempfile.TemporaryFile("w+")  # noqa: SIM115 (closed with the process)
    process = subprocess.Popen(
        [str(binary()), "serve", *flags],
        stdout=subprocess.PIPE,
        stderr=log,
        text=True,
        cwd=tempfile.gettempdir(),
        env=env,
    )
    late = threading.Timer(PATIENCE_S, process.kill)
    late.start()
    found: dict[str, str] = {}
    try:
        assert process.stdout is not None
        for line in process.stdout:
            for key, pattern in (("grpc", r"(grpcs?://\S+)"), ("http", r"(https?://\S+)")):
                if match := re.search(pattern, line):
                    found[key] = match[1]
            if line.startswith("map "):
                break
        else:
            log.seek(0)
            raise AssertionError(f"the server did not start: {log.read()}")
    finally:
        late.cancel()
    return Server(found["grpc"], found["http"], f"zenoh+tcp://127.0.0.1:{port}", process, log)


def encoder() -> list[str]:
    """The settings of the static text encoder, where it is installed."""
    folder = (
        pathlib.Path(os.environ.get("ORENX_TEST_ENCODERS", ROOT / "target/encoders")) / "static"
    )
    return ["encoder.kind=static", f"encoder.folder={folder}"] if folder.is_dir() else []


def needs_encoder() -> None:
    if not encoder():
        pytest.skip("skipped: no text encoder in ORENX_TEST_ENCODERS")
