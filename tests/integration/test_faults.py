"""Faults in the middle of real runs: a wheel sticks, an obstacle appears, the disk fills up, the loss is not finite."""

import logging
import os
import shutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from PIL import Image

import anm_mj.run
from anm_mj.config import make_config
from anm_mj.events import On, Stepped
from anm_mj.explore import explore
from anm_mj.io.jsonl import read_jsonl
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.policies.registry import make_policy
from anm_mj.scene.importing.import_scene import import_scene
from anm_mj.sim.make_robot import make_robot
from anm_mj.sim.sim_robot import SimRobot
from anm_mj.types import OCCUPIED, Action, Pose2, StopReason
from tests.fake_robot import ListRecorder
from tests.integration.test_kills import GROWING, TINY, assert_same, finished, words
from tests.robots import let_wheel_stick
from tests.scene.shapes import room
from tests.scene.small import make_small_scene

pytestmark = pytest.mark.usefixtures("quick_results")

MAY_MOUNT = (
    shutil.which("unshare") is not None
    and not subprocess.run(
        ["unshare", "-m", "mount", "-t", "tmpfs", "none", "/mnt"], capture_output=True, check=False
    ).returncode
)
"""A small disk to fill up can be made where one may mount."""


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scenes") / "small"
    make_small_scene(folder)
    return folder


def configuration(scene, *, settings=(), **options):
    return make_config("quick", [*TINY, *settings], scene=str(scene), seed=3, device="cpu", **options)


def test_a_wheel_that_sticks_ends_the_run(small, tmp_path, caplog, monkeypatch):
    act = SimRobot.act

    def act_and_break(robot, action):
        if robot.step == 5:
            let_wheel_stick(robot.model, left=True, prefix="robot/")
        return act(robot, action)

    monkeypatch.setattr(SimRobot, "act", act_and_break)
    # A motion that has been begun goes on in a thread, and must not see the model change.
    monkeypatch.setattr(SimRobot, "anticipate", lambda *_: None)
    config = configuration(small, drive="physics", steps=40)
    _, metrics = anm_mj.run.run(config, out=tmp_path / "run")
    assert metrics.stop_reason == "WHEEL_STUCK"
    assert metrics.steps == 5 + 6
    warned = [record.message for record in caplog.records if record.levelno >= logging.WARNING]
    assert warned[0].startswith("The left wheel turned by ")
    assert warned[-1] == "the robot can drive no more (WHEEL_STUCK); the run ends at step 11."
    assert NeuralMap.load(tmp_path / "run" / "map.safetensors").occupancy_grid().state.size > 0


LEDGE = """<mujoco><worldbody>
<geom type="box" size="1.4 .5 .05" pos="-1.1 0 -.05" rgba=".5 .4 .3 1"/>
<geom type="box" size=".05 .5 1.3" pos="-2.5 0 1.3" rgba=".8 .8 .7 1"/>
</worldbody></mujoco>"""
"""A floor with one wall and three open edges."""


@pytest.mark.parametrize("blind_from", [None, 6])
def test_open_edges_are_no_fault_but_a_dead_camera_is(tmp_path, caplog, monkeypatch, blind_from):
    (tmp_path / "ledge.xml").write_text(LEDGE)
    scene = import_scene(tmp_path / "ledge.xml", tmp_path / "ledge")
    observe, blind = SimRobot.observe, []

    def observe_or_not(robot):
        seen = observe(robot)
        if blind_from is not None and robot.step >= blind_from:
            return replace(seen, depth_m=np.full_like(seen.depth_m, np.inf))
        blind.append(not np.isfinite(seen.depth_m).any())
        return seen

    monkeypatch.setattr(SimRobot, "observe", observe_or_not)
    config = configuration(scene.folder, steps=60, start=(0.0, 0.0, 180.0))
    _, metrics = anm_mj.run.run(config, out=tmp_path / "run")
    if blind_from is None:
        assert metrics.stop_reason != "SENSOR_FAULT"
        assert sum(blind) > 12
    else:
        assert metrics.stop_reason == "SENSOR_FAULT"
        assert "the map expected surface within " in caplog.text


class Appearing:
    """A robot in whose scene something appears after so many steps."""

    def __init__(self, before, after, after_steps):
        self.robot, self._after, self._steps = before, after, after_steps

    @property
    def footprint(self):
        return self.robot.footprint

    def observe(self):
        return self.robot.observe()

    def drive(self, twist, duration_s):
        return self.robot.drive(twist, duration_s)

    def act(self, action: Action):
        if self.robot.step == self._steps:
            pose, step = self.robot.pose, self.robot.step
            self.robot = self._after
            self.robot.place(pose)
            self.robot.step = step
        return self.robot.act(action)


def box(low, high):
    return trimesh.creation.box(bounds=[low, high])


CRATE_FRONT_M = 2.85
WALLS = [box([2.9, 0.0, 0.0], [3.1, 1.5, 2.5]), box([2.9, 2.5, 0.0], [3.1, 4.0, 2.5])]
CRATE = box([CRATE_FRONT_M, 1.4, 0.0], [3.15, 2.6, 1.0])


FRONT = np.stack(np.meshgrid([CRATE_FRONT_M], np.arange(1.6, 2.41, 0.1), np.arange(0.2, 0.81, 0.1)), -1).reshape(-1, 3)


def front(grid):
    """How much of the crate's front the map holds for occupied, up to the robot's eyes."""
    inner = FRONT + np.array([0.02, 0.0, 0.0])
    index = np.floor((inner[:, ::-1] - grid.origin_m[::-1]) / grid.resolution_m).astype(int)
    inside = ((index >= 0) & (index < grid.state.shape)).all(axis=1)
    return float((grid.state[tuple(index[inside].T)] == OCCUPIED).sum()) / len(index)


def sees_front(observation):
    """Whether half of the crate's front is in an image, where it is."""
    T, camera = observation.T_world_camera, observation.intrinsics
    x, y, z = ((FRONT - T[:3, 3]) @ T[:3, :3]).T
    ahead = z > 0.1
    z = np.where(ahead, z, 1.0)
    col, row = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
    inside = ahead & (col >= 0) & (col < camera.width) & (row >= 0) & (row < camera.height)
    found = observation.depth_m[row[inside].astype(int), col[inside].astype(int)]
    return np.count_nonzero(np.abs(found - z[inside]) < 0.1) > len(FRONT) / 2


@pytest.mark.slow
@pytest.mark.parametrize("drive", ["kinematic", "physics"])
@pytest.mark.parametrize("policy", ["gvg", "anm-s"])
def test_an_obstacle_that_appears_where_the_map_said_free(tmp_path, drive, policy):
    """The only door is closed while the robot is on its way to it."""
    scenes = []
    for name, meshes in (("open", WALLS), ("closed", [*WALLS, CRATE])):
        trimesh.Scene([room(), *meshes]).export(tmp_path / f"{name}.glb")
        scenes.append(import_scene(tmp_path / f"{name}.glb", tmp_path / name))
    start, appears = Pose2(1.0, 2.0, 0.0), 42
    robots = [make_robot(scene, start=start, drive=drive, image_px=96) for scene in scenes]
    config = configuration(scenes[0].folder, policy=policy)
    mapper = NeuralMap(config.mapping, seed=3, device="cpu")
    context = PolicyContext(robots[0].footprint, config.policy_settings, config.planning, 3, goal="coverage")
    robot, recorder, held, seen = Appearing(*robots, appears), ListRecorder(), [], []

    def note(report):
        held.append(front(mapper.occupancy_grid()))
        seen.append(report.step > appears and sees_front(report.observation))

    outcome = explore(
        robot, mapper, make_policy(policy, context), num_steps=400, observers=(recorder, On(Stepped, note))
    )
    noticed = sum(seen[: next(step for step, share in enumerate(held, 1) if share >= 0.5)])
    collisions = sum(result.collided for _, result, *_ in recorder.steps)
    east = max(pose.x_m for _, _, pose, _ in recorder.steps)
    print(
        policy, drive, outcome.stop_reason, outcome.num_steps, "noticed after views", noticed, "collisions", collisions
    )
    assert held[appears - 1] == 0.0
    assert 1 <= noticed <= 8
    assert east < CRATE_FRONT_M - robots[0].footprint.radius_m + 0.01
    assert outcome.stop_reason in (StopReason.NO_REACHABLE_TARGET, StopReason.COMPLETE)
    assert collisions <= 3
    # What the map says at the end is what is there.
    assert front(mapper.occupancy_grid()) > 0.9
    for each in robots:
        each.close()


def test_a_loss_that_is_not_finite_takes_the_map_back_and_the_run_goes_on(small, tmp_path, monkeypatch, caplog):
    config = configuration(small, settings=GROWING, steps=12)
    engine = type(NeuralMap(config.mapping, seed=0, device="cpu").backend)
    steps, done = engine.steps, []

    def spoil(self, *arguments):
        losses, before = steps(self, *arguments), len(done)
        done.extend(losses)
        if before < 20 <= len(done):
            state = self.get_state()
            state["sdf_out"][:] = np.nan
            self.set_state(state)
        return losses

    monkeypatch.setattr(engine, "steps", spoil)
    _, metrics = anm_mj.run.run(config, out=tmp_path / "run")
    assert metrics.stop_reason == "BUDGET"
    assert metrics.observed_accuracy_cm < 10.0
    assert caplog.text.count("; the map goes back to what it was") == 1
    (untrained,) = [line for line in read_jsonl(tmp_path / "run" / "steps.jsonl") if line["loss"] is None]
    assert (
        f"became nan (rgb nan, depth nan, sdf nan, free_space nan, smoothness 0) at step {untrained['step']}; the map"
        in (caplog.text)
    )


SCRIPT = """
mount -t tmpfs -o size={size}k none {disk} || exit 99
{explore} --out {disk}/run & run=$!
if [ {fill} = 1 ]; then
  until [ "$(cat {disk}/run/steps.jsonl 2>/dev/null | wc -l)" -ge 5 ]; do sleep 0.01; done
  cat /dev/zero > {disk}/ballast 2>/dev/null
fi
wait $run; echo "status $?"
rm -f {disk}/ballast
cp -r {disk}/run {kept}
mount -o remount,size=1000m {disk}
{resume} {disk}/run; echo "status $?"
cp -r {disk}/run {resumed}
"""


def on_a_disk(tmp_path, scene, size_kib, *, fill):
    """What a run says on a disk that is too small, or that others fill, and when it is resumed on a larger one."""
    anm_mj_command = f"{sys.executable} -m anm_mj.cli explore"
    disk = tmp_path / "disk"
    disk.mkdir()
    line = " ".join(map(str, words(scene, steps=36, settings=TINY)))
    script = SCRIPT.format(
        size=size_kib,
        fill=int(fill),
        disk=disk,
        kept=tmp_path / "full",
        resumed=tmp_path / "resumed",
        explore=f"{anm_mj_command} {line}",
        resume=f"{anm_mj_command} --resume",
    )
    done = subprocess.run(
        ["unshare", "-m", "sh", "-c", script],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
        env=os.environ | {"COLUMNS": "400"},
    )
    first, _, rest = done.stdout.partition("status ")
    return first, int(rest[0]), rest.partition("status ")[2].strip()


@pytest.fixture(scope="module")
def undisturbed(small, tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole") / "run"
    finished(*words(small, steps=36, settings=TINY), "--out", folder)
    return folder


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.skipif(not MAY_MOUNT, reason="no file system can be mounted here")
@pytest.mark.parametrize("size_kib", [300, 30_000, 41_500, 300_000])
def test_a_disk_that_fills_up_is_one_sentence_and_the_run_goes_on_with_a_larger_one(
    small, undisturbed, tmp_path, size_kib
):
    """Too small for the truth, for a checkpoint, for a second one, and large enough until others fill it."""
    said, status, after = on_a_disk(tmp_path, small, size_kib, fill=size_kib == 300_000)
    sentence = said.strip().splitlines()[-1]
    print(size_kib, sentence)
    full = tmp_path / "full"
    assert "Traceback" not in said + after
    assert not [path for path in full.rglob(".*") if path.is_file()]
    if status == 0:
        assert_same(full, undisturbed)
        return
    assert status == 2
    assert sentence.startswith("anm-mj: ")
    assert "No space left on device" in sentence or "more than the disk has free" in sentence
    for path in full.glob("depth/*.png"):
        with Image.open(path) as image:
            image.load()
    for path in full.glob("*.jsonl"):
        assert read_jsonl(path) is not None
    kept = list(full.glob("checkpoint/*.checkpoint"))
    assert ("Then go on with: anm-mj explore --resume" in sentence) == bool(kept)
    if kept:
        assert after.endswith("0"), after
        assert_same(tmp_path / "resumed", undisturbed)
    else:
        # Nothing was lost: it had not begun.
        assert not (full / "steps.jsonl").exists() or len(read_jsonl(full / "steps.jsonl")) <= 20
