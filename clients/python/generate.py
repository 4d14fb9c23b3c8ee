#!/usr/bin/env python3
"""Writes src/orenx/v1 from the proto files, which are the only truth: python generate.py [FOLDER].

The result is part of the repository, so that `pip install` needs neither protoc nor the proto files.
A test compares it with what this writes. Needs grpcio-tools at the version below: its code runs
with protobuf 6.31.1 and later, also on Python 3.9.
"""

import importlib.metadata
import pathlib
import sys

GRPCIO_TOOLS = "1.76.0"
HERE = pathlib.Path(__file__).resolve().parent


def generate(folder: pathlib.Path) -> None:
    """Writes orenx/v1/*_pb2.py and .pyi below the folder."""
    from grpc_tools import protoc

    installed = importlib.metadata.version("grpcio-tools")
    if installed != GRPCIO_TOOLS:
        raise SystemExit(
            f"grpcio-tools {installed} is here; pip install grpcio-tools=={GRPCIO_TOOLS}"
        )
    proto = HERE.parent.parent / "proto"
    files = sorted(str(path) for path in proto.glob("orenx/v1/*.proto"))
    code = protoc.main(
        ["protoc", f"-I{proto}", f"--python_out={folder}", f"--pyi_out={folder}", *files]
    )
    if code != 0:
        raise SystemExit(f"protoc ended with {code}")


if __name__ == "__main__":
    generate(pathlib.Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "src")
