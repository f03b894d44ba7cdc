"""Measures how many steps a second one environment takes, and how much of a step is MuJoCo's renderer.

    python scripts/bench_environment.py home aws_small_house --image-px 128

Random actions that go forward three times in five, on one process, as one worker of a vector environment would. Times
are of the process's processors, so that they can be added up over workers; the rate is by the wall clock.
"""

import importlib
import time
from typing import Annotated, Any

import gymnasium
import numpy as np
import tyro

import anm_mj.environments  # noqa: F401  registers the environment
from anm_mj.cli.command_line import run_script
from anm_mj.sim import gl

_ACTIONS = (1, 1, 1, 2, 3)
"""FORWARD three times, LEFT, RIGHT."""


def main(
    scenes: Annotated[tuple[str, ...], tyro.conf.Positional] = ("home",), image_px: int = 128, steps: int = 400
) -> None:
    """Print a row per scene, with and without the map about the robot.

    Args:
        scenes: names or folders.
        image_px: width and height of the images.
        steps: that are measured.
    """
    gl.select_backend()
    mujoco: Any = importlib.import_module("mujoco")  # Bound to that back-end from now on.
    rendering_s = [0.0]
    render = mujoco.mjr_render

    def timed_render(*args: object) -> None:
        began = time.thread_time()
        render(*args)
        rendering_s[0] += time.thread_time() - began

    mujoco.mjr_render = timed_render
    print(f"{'scene':20s} {'map':5s} {'steps/s':>8s} {'ms of the processor':>20s} {'in the renderer':>16s}")
    for scene in scenes:
        for topdown in (False, True):
            env = gymnasium.make(
                "AnmMj/Explore-v0", scene=scene, image_px=image_px, num_steps=10 * steps, topdown=topdown
            )
            env.reset(seed=0)
            random = np.random.default_rng(0)
            _drive(env, random, 40)
            rendering_s[0], used_s, began = 0.0, time.process_time(), time.perf_counter()
            _drive(env, random, steps)
            rate = steps / (time.perf_counter() - began)
            used_ms, renderer_ms = (1e3 * s / steps for s in (time.process_time() - used_s, rendering_s[0]))
            print(f"{scene:20s} {'yes' if topdown else 'no':5s} {rate:8.1f} {used_ms:20.2f} {renderer_ms:16.2f}")
            env.close()


def _drive(env: gymnasium.Env, random: np.random.Generator, steps: int) -> None:
    for action in random.choice(_ACTIONS, steps):
        _, _, terminated, truncated, _ = env.step(int(action))
        if terminated or truncated:
            env.reset(seed=0)


if __name__ == "__main__":
    run_script(main)
