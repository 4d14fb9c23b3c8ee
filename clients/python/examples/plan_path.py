"""Plans a path for a robot made of spheres, by the gradient of the map's distance.

    python plan_path.py --start 1.3,1.2,1.0 --goal -1.2,-1.5,1.0

Many candidates at a time bend away from obstacles and stay smooth (as CHOMP does); each round is one
question with all spheres of all candidates. What is unknown counts as an obstacle. The shortest that the
server finds safe, also between its poses, is the answer.
"""

from __future__ import annotations

import argparse

import numpy as np

import orenx

# A robot 0.2 m wide and 0.5 m high, in its body frame: x y z r.
ROBOT = np.array([[0, 0, -0.15, 0.1], [0, 0, 0, 0.1], [0, 0, 0.15, 0.1]])


def candidates(
    start: np.ndarray, goal: np.ndarray, count: int, poses: int, seed: int = 0
) -> np.ndarray:
    """(count, poses, 3) positions: a straight line, and lines that bow to random sides."""
    random = np.random.default_rng(seed)
    share = np.linspace(0, 1, poses)[:, None]
    straight = start + share * (goal - start)
    bows = random.normal(size=(count, 1, 3)) * [1.0, 1.0, 0.3] * np.linalg.norm(goal - start) / 3
    bows[0] = 0
    return straight + np.sin(np.pi * share) * bows


def bend(
    m: orenx.Map, paths: np.ndarray, *, rounds: int = 60, keep_m: float = 0.15, epoch: int = 0
) -> np.ndarray:
    """Moves the poses between the ends away from obstacles and towards their neighbours."""
    count, poses, _ = paths.shape
    steps = 2 * np.eye(poses - 2) - np.eye(poses - 2, k=1) - np.eye(poses - 2, k=-1)
    smooth = np.linalg.inv(np.eye(poses - 2) + 10 * steps)
    for _ in range(rounds):
        centers = paths[:, :, None, :] + ROBOT[:, :3]
        radii = np.broadcast_to(ROBOT[:, 3:], (*centers.shape[:-1], 1))
        spheres = np.concatenate([centers, radii], axis=-1).reshape(-1, 4)
        answer = m.query_spheres(
            spheres, unknown="occupied", unknown_distance_m=0.3, min_epoch=epoch
        )
        clearance = answer.clearance.reshape(count, poses, len(ROBOT))
        gradient = answer.gradient.reshape(count, poses, len(ROBOT), 3)
        too_close = np.maximum(keep_m - clearance, 0)[..., None]
        push = (too_close * gradient).sum(axis=2)[:, 1:-1]
        inner = paths[:, 1:-1]
        # The second differences of the path pull it straight.
        pull = paths[:, :-2] + paths[:, 2:] - 2 * inner
        paths[:, 1:-1] = inner + np.einsum("ij,cjk->cik", smooth, 1.2 * push + 0.4 * pull)
    return paths


def plan(
    m: orenx.Map,
    start: np.ndarray,
    goal: np.ndarray,
    *,
    count: int = 24,
    poses: int = 32,
    epoch: int = 0,
) -> tuple[np.ndarray | None, orenx.Verdicts]:
    """The shortest safe candidate, (poses, 3), or None; and what the server says of all of them."""
    paths = bend(m, candidates(start, goal, count, poses), epoch=epoch)
    upright = np.broadcast_to([0.0, 0.0, 0.0, 1.0], (count, poses, 4))
    trajectories = np.concatenate([paths, upright], axis=-1)
    verdicts = m.check_trajectories(
        ROBOT, trajectories, swept=True, unknown="occupied", min_epoch=epoch
    )
    lengths = np.linalg.norm(np.diff(paths, axis=1), axis=-1).sum(axis=1)
    lengths[~verdicts.safe] = np.inf
    best = int(lengths.argmin())
    return (paths[best] if np.isfinite(lengths[best]) else None), verdicts


def numbers(text: str) -> np.ndarray:
    return np.array([float(part) for part in text.split(",")])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--url", default="grpc://127.0.0.1:7610")
    parser.add_argument("--map", default="default")
    parser.add_argument("--start", type=numbers, required=True, help="x,y,z")
    parser.add_argument("--goal", type=numbers, required=True)
    options = parser.parse_args()
    with orenx.connect(options.url) as client:
        path, verdicts = plan(client.map(options.map), options.start, options.goal)
    print(
        f"{verdicts.safe.sum()} of {len(verdicts.trajectories)} candidates are safe, epoch {verdicts.epoch}"
    )
    if path is None:
        raise SystemExit("no safe path found")
    print("\n".join(",".join(f"{x:.3f}" for x in point) for point in path))
