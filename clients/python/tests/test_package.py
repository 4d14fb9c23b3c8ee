"""What `pip install` gets."""

from __future__ import annotations

import inspect
import subprocess
import sys
import zipfile

import pytest
from servers import ROOT

import orenx
import orenx.aio

HERE = ROOT / "clients/python"


def test_the_messages_are_those_of_the_proto_files(tmp_path):
    pytest.importorskip("grpc_tools", reason="skipped: grpcio-tools is not installed")
    subprocess.run([sys.executable, HERE / "generate.py", tmp_path], check=True)
    written = sorted(path.name for path in (tmp_path / "orenx/v1").iterdir())
    kept = sorted(path.name for path in (HERE / "src/orenx/v1").glob("*_pb2.py*"))
    assert kept == written, "run clients/python/generate.py"
    for name in written:
        fresh = (tmp_path / "orenx/v1" / name).read_text()
        assert (HERE / "src/orenx/v1" / name).read_text() == fresh, (
            f"{name}: run clients/python/generate.py"
        )


def test_a_wheel_has_all_that_it_needs(tmp_path):
    pytest.importorskip("hatchling", reason="skipped: hatchling is not installed")
    pip = [
        sys.executable,
        "-m",
        "pip",
        "wheel",
        "--quiet",
        "--no-deps",
        "--no-index",
        "--no-build-isolation",
    ]
    subprocess.run([*pip, "--wheel-dir", tmp_path, HERE], check=True)
    (wheel,) = tmp_path.glob("*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    assert {"orenx/py.typed", "orenx/aio.py", "orenx/v1/query_pb2.py"} <= set(names)
    code = f"import sys; sys.path.insert(0, {str(wheel)!r}); import orenx; print(orenx.__file__)"
    said = subprocess.run(
        [sys.executable, "-I", "-c", code], check=True, capture_output=True, text=True
    )
    assert str(wheel) in said.stdout


def methods(kind: type) -> dict[str, list[str]]:
    """Names of parameters by the names of methods, as help() shows them."""
    found = {}
    for name, member in vars(kind).items():
        if not name.startswith("_"):
            signature = getattr(member, "__signature__", None) or inspect.signature(member)
            found[name] = list(signature.parameters)
    return found


@pytest.mark.parametrize(
    ("threads", "loop"), [(orenx.Map, orenx.aio.Map), (orenx.Client, orenx.aio.Client)]
)
def test_both_clients_have_the_same_methods(threads, loop):
    ours, theirs = methods(threads), methods(loop)
    ours.pop("wait_ready", None)
    assert ours == theirs


def test_every_public_method_is_documented():
    for kind in (orenx.Map, orenx.Client, orenx.FrameStream):
        for name, member in vars(kind).items():
            assert name.startswith("_") or member.__doc__ or isinstance(member, str), name
