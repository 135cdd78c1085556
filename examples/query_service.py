"""Ask a running service, as a planner does: one pose, a path, a mistake, many at once, nobody there.

Start one first: gpcorrect serve MODEL. Then: python examples/query_service.py [--endpoint tcp/127.0.0.1:7449]
"""

from __future__ import annotations

import argparse
import asyncio

import numpy as np

from gpcorrect_service import AsyncCorrectionClient, CorrectionClient, ServiceError


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--endpoint", default="tcp/127.0.0.1:7449")
    options.add_argument("--timeout", type=float, default=2.0)
    options.add_argument(
        "--pose", type=float, nargs=7, help="x y z qw qx qy qz; the middle of the training data without it"
    )
    given = options.parse_args()
    with CorrectionClient(given.endpoint, timeout=given.timeout) as client:
        pose = middle_of_training(client) if given.pose is None else np.array(given.pose)
        one_pose(client, pose)
        a_path(client, pose)
        a_mistake(client, pose)
    asyncio.run(many_at_once(given.endpoint, given.timeout, pose))
    nobody_there(pose)


def middle_of_training(client: CorrectionClient) -> np.ndarray:
    """Return the middle of the positions that the model was trained on, upright."""
    region = client.model().info["training_region"]
    position = (np.array(region["position_min"]) + np.array(region["position_max"])) / 2
    return np.array([*position, 1.0, 0.0, 0.0, 0.0])


def one_pose(client: CorrectionClient, pose: np.ndarray) -> None:
    reply = client.correct(pose, twist=[0.02, 0, 0, 0, 0, 0])
    print(f"one pose: {reply.status}, command {np.round(reply.position, 4)} m")
    print(f"  within +- {np.round(1e3 * reply.interval95[:3], 2)} mm; in domain: {reply.in_domain}")
    print(f"  by model {reply.meta.model_id} on {reply.meta.replica}")


def a_path(client: CorrectionClient, pose: np.ndarray) -> None:
    """Velocities are computed along the path, so a planner sends poses and times only."""
    times = np.arange(0.0, 1.0, 0.01)
    poses = np.tile(pose, (len(times), 1))
    poses[:, 0] += 0.01 * np.sin(2 * np.pi * times)
    reply = client.correct_path(poses, times)
    print(f"a path: {len(reply.position)} commands, {np.mean(reply.in_domain):.0%} in domain")


def a_mistake(client: CorrectionClient, pose: np.ndarray) -> None:
    """Errors say what came, and what to do."""
    try:
        client.correct([*pose[:3], 0.0, 0.0, 0.0, 0.0])
    except ServiceError as error:
        print(f"a mistake: {error}")


async def many_at_once(endpoint: str, timeout: float, pose: np.ndarray) -> None:
    """Fifty questions under way at the same time, without a thread each."""
    async with AsyncCorrectionClient(endpoint, timeout=timeout) as client:
        replies = await asyncio.gather(*(client.correct(pose) for _ in range(50)))
    print(f"many at once: {len(replies)} replies, {sum(r.status == 'OK' for r in replies)} OK")


def nobody_there(pose: np.ndarray) -> None:
    """With on_failure="identity" the registered pose comes back once a server has answered; before, it is an error."""
    with CorrectionClient("tcp/127.0.0.1:1", connect_timeout=0.1, on_failure="identity") as client:
        try:
            client.correct(pose)
        except ServiceError as error:
            print(f"nobody there: {error.status}")


if __name__ == "__main__":
    main()
