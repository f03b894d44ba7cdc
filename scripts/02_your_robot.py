"""Writes a robot in MJCF, says what is understood of it, and explores with it.

    python scripts/02_your_robot.py
    python scripts/02_your_robot.py --robot my_robot.xml

Two driven wheels and a camera are enough; motors, footprint, base frame and the rest are derived (docs/robot.md).
"""

from pathlib import Path

import anm_mj
from anm_mj.cli.command_line import run_script
from anm_mj.cli.main import main as command

ROBOT = """
<mujoco model="my_robot">
  <worldbody>
    <body name="base" pos="0 0 0.08">
      <freejoint/>
      <geom name="body" type="cylinder" size="0.15 0.05" pos="0 0 0.04" mass="6"/>
      <geom name="mast" type="cylinder" size="0.02 0.35" pos="-0.05 0 0.44" mass="0.5"/>
      <geom name="caster" type="sphere" size="0.02" pos="-0.12 0 -0.06" mass="0.1"/>
      <camera name="camera" pos="-0.02 0 0.8" xyaxes="0 -1 0 0 0 1" fovy="75"/>
      <body name="left_wheel" pos="0 0.16 0">
        <joint name="left_wheel" axis="0 1 0"/>
        <geom type="cylinder" size="0.08 0.015" euler="90 0 0" mass="0.4"/>
      </body>
      <body name="right_wheel" pos="0 -0.16 0">
        <joint name="right_wheel" axis="0 1 0"/>
        <geom type="cylinder" size="0.08 0.015" euler="90 0 0" mass="0.4"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <velocity name="left_wheel" joint="left_wheel" kv="5"/>
    <velocity name="right_wheel" joint="right_wheel" kv="5"/>
  </actuator>
</mujoco>
"""


def main(robot: str | None = None, scene: str = "home", drive: str = "kinematic", steps: int = 200) -> None:
    """Check a robot and explore with it.

    Args:
        robot: an MJCF file, or a name such as stretch3; without one, the robot above is written to my_robot.xml.
        scene: name (anm-mj scene list), or path of a scene folder.
        drive: "kinematic" (exact actions) or "physics" (wheel torque and contact).
        steps: budget of actions.
    """
    if robot is None:
        robot = "my_robot.xml"
        Path(robot).write_text(ROBOT, encoding="utf-8")

    if command(["robot", "check", robot]) != 0:  # Also drives it over an empty floor, and draws it.
        raise SystemExit(f"{robot} cannot be used")

    made = anm_mj.explore_scene(scene, robot=robot, drive=drive, steps=steps)
    print(f"seen to 5 cm: {made.metrics['completion_ratio']:.1f} % of the surface; {made.folder}")


if __name__ == "__main__":
    run_script(main)
