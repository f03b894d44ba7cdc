"""Maps a recorded sequence and plans on it, frame by frame, without a simulator.

    python scripts/recorded_sequence.py /tmp/walk --out /tmp/map

The sequence may come from scripts/record_sequence.py or from a real camera with known poses (format:
anm_mj/io/sequence.py). This script does not import MuJoCo. To drive a real robot, write a class with the methods of
anm_mj.protocols.Robot and pass it to anm_mj.explore.explore.
"""

from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from anm_mj.config import make_config
from anm_mj.evaluation.depth import MAX_DEPTH_M
from anm_mj.io.mesh_file import write_mesh
from anm_mj.io.sequence import read_sequence
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.policies.registry import make_policy
from anm_mj.types import Footprint, Plan
from anm_mj.viz.plots import draw_topdown


def main(
    sequence: Annotated[Path, tyro.conf.Positional],
    out: Path,
    every: int = 20,
    policy: str = "gvg",
    preset: str = "quick",
    radius_m: float = 0.18,
    height_m: float = 1.35,
    seed: int = 0,
) -> None:
    """Map the sequence, plan at intervals, and write the mesh and the top-down map of the last plan.

    Args:
        sequence: folder of the recording.
        out: folder for mesh.ply and topdown.png.
        every: frames between two plans.
        policy: chooses the targets.
        preset: mapping effort: quick, default or paper.
        radius_m: radius of the robot [m].
        height_m: height of the robot [m].
        seed: of map and policy.
    """
    recorded = read_sequence(sequence)
    config = make_config(preset, [], scene=str(sequence), policy=policy, seed=seed)
    mapper = NeuralMap(config.mapping, seed=seed, device="cpu")
    footprint = Footprint(radius_m, 0.05, height_m)
    planner = make_policy(policy, PolicyContext(footprint, config.policy_settings, config.planning, seed))
    plan, poses = Plan("no frame yet", np.zeros((0, 2))), []
    for observation in recorded.observations():
        mapper.integrate(observation)
        planner.observe(observation)
        poses.append(observation.pose)
        last = observation.step == len(recorded) - 1
        if last or (observation.step and observation.step % every == 0):
            plan = planner.plan(mapper, observation)
            target = "stays" if plan.target_xy_m is None else "would go to ({:.2f}, {:.2f})".format(*plan.target_xy_m)
            print(f"frame {observation.step}: {target}: {plan.reason}")
    out.mkdir(parents=True, exist_ok=True)
    mesh = mapper.mesh(0.05)
    write_mesh(out / "mesh.ply", mesh)
    if plan.topdown is not None:
        draw_topdown(
            out / "topdown.png",
            plan.topdown,
            plan.graph,
            plan.regions,
            poses,
            target_xy_m=plan.target_xy_m,
            title=f"{sequence.name}: {len(poses)} frames, depth to {MAX_DEPTH_M:g} m",
        )
    print(f"Wrote {len(mesh.vertices)} vertices and {len(mesh.faces)} faces to {out / 'mesh.ply'}.")


if __name__ == "__main__":
    tyro.cli(main)
