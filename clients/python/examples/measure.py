"""How long a planner's questions take from Python, there and back: median and 95th percentile.

python measure.py             # asks about random places within the map's bounds
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np

import orenx


def measure(ask: Callable[[], orenx.Answer], times: int) -> tuple[float, float, float]:
    """Median and 95th percentile there and back, and the median of the server's share, ms."""
    ask()
    took, server = [], []
    for _ in range(times):
        began = time.perf_counter()
        answer = ask()
        took.append((time.perf_counter() - began) * 1e3)
        server.append(answer.server_us / 1e3)
    return float(np.median(took)), float(np.percentile(took, 95)), float(np.median(server))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("url", nargs="?", default="grpc://127.0.0.1:7610")
    parser.add_argument("--map", default="default")
    parser.add_argument("--times", type=int, default=20)
    options = parser.parse_args()
    random = np.random.default_rng(0)
    with orenx.connect(options.url) as client:
        m = client.map(options.map)
        bounds = m.info().map.bounds
        if bounds is None:
            raise SystemExit("the map is empty")
        points = random.uniform(bounds.min, bounds.max, (62_464, 3))
        spheres = np.column_stack([points, random.uniform(0.02, 0.1, len(points))])
        vectors = ["distance", "gradient", "state"]
        questions: dict[str, Callable[[], orenx.Answer]] = {
            "1 000 points, distance, gradient, state": lambda: m.query_points(
                points[:1000], fields=vectors
            ),
            "10 000 points, distance, gradient, state": lambda: m.query_points(
                points[:10_000], fields=vectors
            ),
            "62 464 spheres (4 × 4 × 64 × 61), clearance, gradient, state": lambda: m.query_spheres(
                spheres
            ),
        }
        for name, ask in questions.items():
            median, high, server = measure(ask, options.times)
            print(
                f"{name}: {median:.1f} ms (95 of 100: {high:.1f} ms), {server:.1f} ms of them in the server"
            )
