"""Random actions in several Gymnasium environments at once: an example, and a measurement of their speed.

    python scripts/gym_random.py home --num-envs 2 --num-steps 200

Each environment has a process of its own. Prints the coverage of a random walk, the baseline of any policy.
"""

import time

import gymnasium
import numpy as np
import tyro

import anm_mj.environments  # noqa: F401  Registers AnmMj/Explore-v0.
from anm_mj.cli.command_line import run_script


def main(scene: tyro.conf.Positional[str], num_envs: int = 2, num_steps: int = 200, seed: int = 0) -> None:
    """Run one episode of random actions.

    Args:
        scene: name from the catalogue, or path of a scene folder.
        num_envs: number of parallel environments.
        num_steps: length of the episode.
        seed: of starts and actions.
    """
    # "spawn": GL does not survive a fork.
    envs = gymnasium.make_vec(
        "AnmMj/Explore-v0",
        num_envs=num_envs,
        vectorization_mode="async",
        vector_kwargs={"context": "spawn"},
        scene=scene,
        num_steps=num_steps,
    )
    _, info = envs.reset(seed=seed)
    start_percent = 100.0 * info["coverage"]
    random = np.random.default_rng(seed)
    begin = time.perf_counter()
    for _ in range(num_steps):
        # Forward twice as often as left or right; 0 would stop.
        *_, info = envs.step(random.choice([1, 1, 2, 3], num_envs))
    rate = num_envs * num_steps / (time.perf_counter() - begin)
    envs.close()
    for i, (before, after) in enumerate(zip(start_percent, 100.0 * info["coverage"], strict=True)):
        print(
            f"environment {i}: {before:.1f} % of the surface seen from the start, {after:.1f} % after {num_steps} steps"
        )
    print(f"{rate:.0f} steps/s")


if __name__ == "__main__":
    run_script(main)
