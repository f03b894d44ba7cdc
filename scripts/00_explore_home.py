"""Explores a furnished house and says what was found. Start here.

    python scripts/00_explore_home.py
    python scripts/00_explore_home.py --scene office --policy anm-s

The same as ``anm-mj explore home --steps 300``, from Python.
"""

import anm_mj
from anm_mj.cli.command_line import run_script
from anm_mj.events import Stepped


def watch(report: Stepped) -> None:
    """Say every 50 steps where the robot is, and why it goes where it goes."""
    if report.step % 50 == 0:
        x_m, y_m = report.observation.pose.xy_m
        print(f"step {report.step:3d}  at ({x_m:5.2f}, {y_m:5.2f}) m  {report.plan.reason}")


def main(scene: str = "home", policy: str = "gvg", steps: int = 300, seed: int = 0) -> None:
    """Explore a scene.

    Args:
        scene: name (anm-mj scene list), or path of a scene folder.
        policy: who decides (docs/planning.md).
        steps: budget of actions.
        seed: of everything random; the same seed gives the same steps.
    """
    made = anm_mj.explore_scene(scene, policy=policy, steps=steps, seed=seed, on_step=watch)

    metrics = made.metrics
    print(f"ended by {metrics['stop_reason']} after {metrics['steps']} steps and {metrics['path_m']:.1f} m")
    print(f"seen to 5 cm: {metrics['completion_ratio']:.1f} % of the surface")
    if metrics["observable_ratio"] is not None:
        print(f"              {metrics['observable_ratio']:.1f} % of what the robot can see at all")

    run = anm_mj.load_run(made.folder)  # Everything as arrays.
    slowest = max((name for name in run.steps if name.startswith("ms_")), key=lambda name: run.steps[name].sum())
    print(f"collisions: {run.steps['collided'].sum()}; most time went into {slowest.removeprefix('ms_')}")
    print(f"map, mesh and pictures: {made.folder}; watch it again: anm-mj view {made.folder}")


if __name__ == "__main__":
    run_script(main)
