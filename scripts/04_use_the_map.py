"""Asks the neural map of a run: distances, uncertainty, a picture from a place of your own, a mesh.

    python scripts/04_use_the_map.py                        # explores first
    python scripts/04_use_the_map.py --run runs/latest      # loads no simulator

Leaves slice.png, view.png and map.glb in --out.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

import anm_mj
from anm_mj.cli.command_line import run_script
from anm_mj.types import OCCUPIED, UNKNOWN, Intrinsics


def main(run: Path | None = None, out: Path = Path(), height_m: float = 0.5, steps: int = 200) -> None:
    """Load a map and use it.

    Args:
        run: folder of a finished run; without one, home is explored.
        out: folder of the pictures and the mesh.
        height_m: of the horizontal slice above the floor.
        steps: of the exploration, where there is no run.
    """
    run = run or anm_mj.explore_scene("home", steps=steps).folder
    neural_map = anm_mj.load_map(run)

    # The grid says what was observed. Anywhere else the field answers too, but means nothing.
    grid = neural_map.occupancy_grid()
    layer = grid.state[grid.layer_of(height_m)]  # [y, x]
    rows, cols = np.indices(layer.shape)
    points = np.stack([cols, rows, np.zeros_like(cols)], axis=-1).reshape(-1, 3) + 0.5
    points = grid.origin_m + points * grid.resolution_m  # In the world [m].
    points[:, 2] = height_m
    sdf_m = np.where(layer == UNKNOWN, np.nan, neural_map.sdf(points).reshape(layer.shape))
    variance = np.where(layer == OCCUPIED, neural_map.uncertainty(points).reshape(layer.shape), np.nan)

    (left, bottom), (right, top) = points[0, :2], points[-1, :2]
    known = points[(layer != UNKNOWN).ravel()]
    figure = Figure(figsize=(11, 4.5), layout="constrained")
    one, other = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, values, name, limits in (
        (one, sdf_m, "signed distance [m]", {"cmap": "RdBu", "vmin": -0.1, "vmax": 0.1}),
        (other, np.log10(variance), "log10 of the uncertainty of the surface", {}),
    ):
        shown = axes.imshow(values, origin="lower", extent=(left, right, bottom, top), **limits)
        figure.colorbar(shown, ax=axes, label=name)
        axes.set(xlabel="x [m]", ylabel="y [m]", title=f"{height_m} m above the floor")
        axes.set(xlim=(known[:, 0].min(), known[:, 0].max()), ylim=(known[:, 1].min(), known[:, 1].max()))
    figure.savefig(out / "slice.png", dpi=120)

    # What a camera would see where the run's camera stood at the end; any other pose will do.
    camera = Intrinsics.from_fov(320, 240, np.deg2rad(70.0))
    rgb, depth_m = neural_map.render(camera, anm_mj.load_run(run).T_world_camera[-1])
    Image.fromarray(rgb).save(out / "view.png")
    print(f"the nearest surface in the view lies {np.nanmin(depth_m):.2f} m away")

    mesh = neural_map.mesh(0.05)
    mesh.export(out / "map.glb")
    print(f"{len(mesh.faces)} faces; {out / 'slice.png'}, {out / 'view.png'}, {out / 'map.glb'}")


if __name__ == "__main__":
    run_script(main)
