"""How far the depth of recorded runs lies from their own meshes: of two maps of a recording, which fits itself better.

python scripts/mesh_against_depth.py runs/a runs/b
"""

from pathlib import Path
from typing import Annotated

import numpy as np
import trimesh
import tyro

from anm_mj.cli.command_line import run_script
from anm_mj.evaluation.surface_distance import surface_distance
from anm_mj.ground_truth.reduced_depth import back_project_reduced
from anm_mj.io.read_run import read_run


def main(runs: Annotated[list[Path], tyro.conf.Positional], reach: float = 3.0) -> None:
    """Print a line for each run.

    Args:
        runs: folders that anm-mj map wrote.
        reach: depth up to here counts [m].
    """
    for path in runs:
        run = read_run(path)
        points = []
        for frame in run.frames:
            depth_mm = run.depth_mm(frame)
            depth_mm = np.where(depth_mm <= 1000.0 * reach, depth_mm, 0).astype(np.uint16)
            points.append(back_project_reduced(depth_mm, run.intrinsics, frame.T_world_camera)[::4])
        mesh = trimesh.load_mesh(run.folder.mesh)
        cm = 100.0 * surface_distance(np.concatenate(points), np.asarray(mesh.vertices), np.asarray(mesh.faces))
        middle, far = np.percentile(cm, (50, 90))
        print(f"{path}: median {middle:.2f} cm, 90 % {far:.2f} cm, {100.0 * np.mean(cm < 2.0):.1f} % within 2 cm")


if __name__ == "__main__":
    run_script(main)
