"""Explores with a simulated robot and records its images as a sequence (its format: docs/robot.md).

python scripts/record_sequence.py home /tmp/walk --steps 200
anm-mj map /tmp/walk --shadow
"""

from pathlib import Path
from typing import Annotated

import tyro

from anm_mj.cli.command_line import run_script
from anm_mj.config import make_config
from anm_mj.events import Observed, On
from anm_mj.explore import explore
from anm_mj.io.own_sequence import SequenceWriter
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.policies.registry import make_policy
from anm_mj.scene.folder import load_scene
from anm_mj.sim.make_robot import make_robot
from anm_mj.sim.simulation_config import SimulationConfig


def main(
    scene: Annotated[str, tyro.conf.Positional],
    out: Annotated[Path, tyro.conf.Positional],
    steps: int = 200,
    policy: str = "gvg",
    drive: str = SimulationConfig.drive,
    image_px: int = SimulationConfig.image_px,
    seed: int = 0,
    people: int = 0,
) -> None:
    """Explore and record.

    Args:
        scene: name or folder of a scene.
        out: new folder of the sequence.
        steps: number of actions; the sequence has one frame more.
        policy: decides where to go.
        drive: kinematic or physics.
        image_px: width and height of the pictures [px].
        seed: of map, policy and people.
        people: who walk through the scene.
    """
    settings = [f"people.number={people}"]
    config = make_config("quick", settings, scene=scene, policy=policy, steps=steps, drive=drive, seed=seed)
    # What cannot be explored leaves no folder.
    world = load_scene(scene)
    writer = SequenceWriter(out)
    with make_robot(world, drive=drive, image_px=image_px, people=config.people, seed=seed) as robot:
        outcome = explore(
            robot,
            NeuralMap(config.mapping, seed=seed, device="cpu"),
            make_policy(policy, PolicyContext(robot.footprint, config.policy_settings, config.planning, seed)),
            num_steps=steps,
            observers=(On(Observed, lambda event: writer.write(event.observation)),),
        )
    print(f"{outcome.num_steps + 1} frames in {out}; stop reason: {outcome.stop_reason}.")


if __name__ == "__main__":
    run_script(main)
