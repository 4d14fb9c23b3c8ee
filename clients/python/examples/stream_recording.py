"""Sends a recorded folder (7-Scenes or TUM RGB-D, as of a RealSense) to a server, as fast as it takes it.

python scene.py room && python stream_recording.py room
python stream_recording.py room zenoh+tcp://127.0.0.1:7447 --labels
"""

from __future__ import annotations

import argparse

import orenx
from orenx import recordings


def stream(
    folder: str,
    url: str,
    *,
    map_id: str = "default",
    robot: str = "recording",
    labels: bool = False,
    stride: int = 1,
) -> orenx.StreamReport:
    """Sends the frames and waits for the last word on each."""
    with orenx.connect(url) as client:
        frames = recordings.frames(folder, labels=labels, stride=stride)
        return client.map(map_id).stream_frames(frames, robot)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder")
    parser.add_argument("url", nargs="?", default="grpc://127.0.0.1:7610")
    parser.add_argument("--map", default="default")
    parser.add_argument("--robot", default="recording")
    parser.add_argument(
        "--labels", action="store_true", help="send labels.json and frame-*.label.png too"
    )
    parser.add_argument("--stride", type=int, default=1)
    o = parser.parse_args()
    report = stream(o.folder, o.url, map_id=o.map, robot=o.robot, labels=o.labels, stride=o.stride)
    print(
        f"{report.integrated} of {report.frames} frames in the map at epoch {report.epoch}, "
        f"{report.frames_per_second:.1f} a second; visible after {report.visible_after_ms[0]:.0f} ms "
        f"(95 of 100: {report.visible_after_ms[1]:.0f} ms)"
    )
    for problem in report.problems:
        print("refused:", problem)
