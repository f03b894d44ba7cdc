"""Learns to explore by PPO in builtin scenes, and compares the agent with random actions in one that it never saw.

    python scripts/06_learn.py                          # some minutes; needs pip install 'anm-mj[learn]'
    python scripts/06_learn.py --people 2               # among people, with a cost of being near them

The agent sees what the top-down map says in 24 directions and is rewarded for newly observed area. Each decision holds
for three actions. Leaves agent.zip, learning.monitor.csv and learning.png in --out.
"""

from functools import partial
from pathlib import Path

import gymnasium
import numpy as np
from matplotlib.figure import Figure
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import SubprocVecEnv, VecMonitor

import anm_mj.environments  # noqa: F401  Registers AnmMj/Explore-v0.
from anm_mj.cli.command_line import run_script
from anm_mj.environments.wrappers import Directions, KeepDistance, RepeatAction

TRAINING, TEST, OUT = ("room", "flat", "office", "residence"), "home", Path("learned")


def make(scenes: tuple[str, ...], num_steps: int, repeat: int, people: int) -> gymnasium.Env:
    """An environment as the agent meets it; every episode draws a scene and a start."""
    options = {"num_steps": num_steps, "image_px": 32, "topdown": True, "stop": False, "reward": "area"}
    env = gymnasium.make("AnmMj/Explore-v0", scene=scenes, people=people, **options)
    return Directions(RepeatAction(KeepDistance(env, within_m=0.5, weight=1.0), repeat))


def train(out: Path, decisions: int, envs: int, num_steps: int, people: int) -> PPO:
    """Learn, in several processes."""
    workers = SubprocVecEnv([partial(make, TRAINING, num_steps, 3, people)] * envs, start_method="spawn")
    watched = VecMonitor(workers, str(out / "learning"), info_keywords=("coverage",))
    options = {"n_steps": 512 // envs, "batch_size": 128, "n_epochs": 6, "gamma": 0.97, "learning_rate": 1e-3}
    agent = PPO("MlpPolicy", watched, ent_coef=0.005, seed=0, device="cpu", **options)
    agent.learn(decisions)
    watched.close()
    return agent


def coverage(env: gymnasium.Env, seed: int, agent: PPO | None) -> float:
    """Observable surface covered in an episode, from a start that the seed draws [%]; None = random actions."""
    (observation, info), random, truncated = env.reset(seed=seed), np.random.default_rng(seed), False
    while not truncated:
        action = random.integers(3) if agent is None else agent.predict(observation)[0]
        observation, _, _, truncated, info = env.step(int(action))
    return 100.0 * info["coverage"]


def draw(out: Path) -> None:
    """The mean reward of the last 20 episodes against the decisions made."""
    log = np.genfromtxt(out / "learning.monitor.csv", delimiter=",", names=True, skip_header=1).reshape(-1)
    axes = (figure := Figure(figsize=(6, 3.5), layout="constrained")).subplots()
    axes.plot(log["l"].cumsum(), [log["r"][max(k - 19, 0) : k + 1].mean() for k in range(len(log))])
    axes.set(xlabel="decisions", ylabel="new area [m²], mean of 20 episodes", ylim=(0, None))
    figure.savefig(out / "learning.png", dpi=120)


def main(
    out: Path = OUT, decisions: int = 8192, envs: int = 4, steps: int = 300, starts: int = 20, people: int = 0
) -> None:
    """Train in processes (envs), in episodes of some steps; then test from random starts, the same for both."""
    out.mkdir(parents=True, exist_ok=True)
    agent = train(out, decisions, envs, steps, people)
    agent.save(out / "agent")
    draw(out)
    thrice, once = make((TEST,), steps, 3, people), make((TEST,), steps, 1, people)
    found = [[coverage(thrice, k, agent), coverage(thrice, k, None), coverage(once, k, None)] for k in range(starts)]
    own, *_ = columns = np.array(found).T
    for name, percent in zip(("agent", "random actions, three times each", "random actions"), columns, strict=True):
        gain, error = own - percent, (own - percent).std(ddof=1) / starts**0.5
        print(f"{name}: {percent.mean():.1f} % of {TEST}; the agent has {gain.mean():+.1f} +- {error:.1f} (paired)")


if __name__ == "__main__":
    run_script(main)
