"""Inputs as people bring them: a sound walk, one kind of fault or habit to each, and the right result.

Every case writes a folder of its own; what it says and how far its mesh is from the walls is judged by the tests.
"""

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from PIL import Image

from anm_mj.frames import pixel_directions
from anm_mj.geometry.lens_distortion import LensDistortion
from anm_mj.types import Intrinsics
from tests.io import bags
from tests.recorded import layouts
from tests.recorded.layouts import EPOCH_S, GL, Y_UP, tum_line
from tests.recorded.walk import CAMERA, PINHOLE, walk

GIVEN = ("--camera", PINHOLE)
WALK = walk()


@dataclass(frozen=True)
class Case:
    """What is brought, and what is right."""

    name: str
    write: Callable
    """Writes it into a folder; gives the path to map, or None for the folder."""
    options: tuple[str, ...] = ()
    frames: int = 12
    says: tuple[str, ...] = ()
    """What is said."""
    refused: bool = False
    """Whether nothing is mapped; else the map is right, unless ``mend`` says what is missing."""
    mend: tuple[str, ...] = ()
    """Options that make the map right, as the check names them."""
    jumps: tuple[str, ...] = ()
    """What is said of poses that jump, at the end of mapping; nothing mends them."""


def rewrite(path, change):
    path.write_text(change(path.read_text()))


def tum(change=None, /, walk=WALK, poses=lambda T: T):
    def write(folder):
        layouts.write_tum(folder, walk, poses)
        return None if change is None else change(folder)

    return write


def replica(change=None, /, poses=lambda T: T):
    def write(folder):
        layouts.write_replica(folder, WALK, poses)
        return None if change is None else change(folder)

    return write


def nerfstudio(change, /):
    def write(folder):
        layouts.write_nerfstudio(folder, WALK)
        facts = json.loads((folder / "transforms.json").read_text())
        change(facts, folder)
        (folder / "transforms.json").write_text(json.dumps(facts))

    return write


# nerfstudio


def per_frame_cameras(facts, _):
    for k, frame in enumerate(facts["frames"]):
        frame["fl_x"] = facts["fl_x"] + 0.01 * (k % 3 - 1)
    del facts["fl_x"]


def one_without_depth(facts, _):
    del facts["frames"][4]["depth_file_path"]


def backslashes_json(facts, _):
    for frame in facts["frames"]:
        frame["file_path"] = frame["file_path"].replace("/", "\\")


def whole_numbers_in_npy(facts, folder):
    for path in (folder / "depth").iterdir():
        np.save(path.with_suffix(".npy"), np.asarray(Image.open(path)).astype(np.uint16))
    facts["depth_unit_scale_factor"] = 0.001
    for frame in facts["frames"]:
        frame["depth_file_path"] = frame["depth_file_path"].replace(".png", ".npy")


def an_angle_alone(facts, _):
    facts["camera_angle_x"] = 2.0 * math.atan(0.5 * facts["w"] / facts["fl_x"])
    for key in ("w", "h", "fl_x", "fl_y", "cx", "cy"):
        del facts[key]


# TUM


WIDE = walk(Intrinsics(128, 72, 40.0, 40.0, 64.0, 36.0), count=6)


def eth3d(folder):
    k = WIDE[0].intrinsics
    (folder / "calibration.txt").write_text(f"{k.fx} {k.fy} {k.cx - 0.5} {k.cy - 0.5}\n")


def a_line_of_nan(folder):
    lines = (folder / "groundtruth.txt").read_text().splitlines()
    lines[5] = f"{lines[5].split()[0]} nan nan nan nan nan nan nan"
    (folder / "groundtruth.txt").write_text("\n".join(lines) + "\n")


def backslashes(folder):
    for name in ("rgb.txt", "depth.txt"):
        rewrite(folder / name, lambda text: text.replace("/", "\\"))


def float_metres(folder):
    for path in (folder / "depth").iterdir():
        Image.fromarray(np.asarray(Image.open(path)).astype(np.float32) / 5000).save(path.with_suffix(".tiff"))
        path.unlink()
    rewrite(folder / "depth.txt", lambda text: text.replace(".png", ".tiff"))


def blank_in_names(folder):
    (folder / "rgb").rename(folder / "my images")
    rewrite(folder / "rgb.txt", lambda text: text.replace("rgb/", "my images/"))


def byte_order_mark(folder):
    rewrite(folder / "groundtruth.txt", lambda text: "\ufeff" + text.replace("\n", "\r\n"))


def commas_and_a_header(folder):
    rewrite(folder / "groundtruth.txt", lambda text: text.replace("# ", "").replace(" ", ","))


def poses_between_images(folder):
    lines = [
        tum_line(EPOCH_S + one.time_s + shift_s, layouts.lifted(one.T_world_camera))
        for one in WALK
        for shift_s in (-0.03, 0.03)
    ]
    (folder / "groundtruth.txt").write_text("\n".join(lines) + "\n")


# Replica, and world or camera axes


def unpadded(folder):
    for path in (folder / "results").iterdir():
        path.rename(path.with_name(f"{path.stem[:-6]}{int(path.stem[-6:])}{path.suffix}"))


def a_pose_of_infinity(folder):
    lines = (folder / "traj.txt").read_text().splitlines()
    lines[7] = " ".join(["-inf"] * 16)
    (folder / "traj.txt").write_text("\n".join(lines) + "\n")


def twelve_numbers(folder):
    rewrite(folder / "traj.txt", lambda text: "".join(f"{' '.join(line.split()[:12])}\n" for line in text.splitlines()))


def a_glitch(folder):
    lines = (folder / "traj.txt").read_text().splitlines()
    numbers = lines[5].split()
    numbers[7] = str(float(numbers[7]) + 1.8)
    lines[5] = " ".join(numbers)
    (folder / "traj.txt").write_text("\n".join(lines) + "\n")


def without_scale(T):
    scaled = T.copy()
    scaled[:3, 3] *= 0.37
    return scaled


def in_first_camera(T):
    return np.linalg.inv(layouts.lifted(WALK[0].T_world_camera)) @ T


def plain(write, walk=WALK):
    return lambda folder: write(folder, walk)


def gl_axes(folder):
    layouts.write_ours(folder / "walk", [replace(one, T_world_camera=one.T_world_camera @ GL) for one in WALK])
    return folder / "walk"


# Bags

STATIC = [("/tf_static", 99.0, bags.tf(99.0, "base", "optical", bags.T_BASE_CAMERA))]
INFO = bags.DEPTH.replace("image_raw", "camera_info")


def seen_by(camera, lens=None):
    """The walk through a lens; radial distortion alone."""
    if lens is None:
        return walk(camera)
    rays = pixel_directions(camera).astype(float)
    far = np.linspace(0.0, lens.farthest(50.0), 200_000)
    bent = np.hypot(rays[..., 0], rays[..., 1])
    rays[..., :2] *= (np.interp(bent, lens.radius(far), far) / np.maximum(bent, 1e-9))[..., None]
    return walk(camera, directions=rays)


def bag(poses=None, *, start_s=100.0, per_metre=1000, lens=None, lies=False, change=None):
    """A recording.

    Args:
        poses: Gives the messages that say where the camera was.
        start_s: Time of the first image [s].
        per_metre: Units of depth.
        lens: The images are bent by it.
        lies: Whether the calibration beside the depth is another one than that beside the colour.
        change: Changes the written folder; gives the path to map.
    """

    def write(folder):
        said = []
        for one in seen_by(CAMERA, lens):
            t = one.time_s + start_s
            info = bags.calibration(t, camera=CAMERA)
            if lens is not None:
                info = replace(info, distortion_model=lens.model, d=np.array(lens.coefficients))
            said += [
                (bags.DEPTH, t, bags.image(t, layouts.units(one.depth_m, 1 / per_metre), "16UC1")),
                (bags.COLOUR, t, bags.image(t, one.rgb[..., ::-1], "bgr8")),
                ("/camera/color/camera_info", t, info),
            ]
            if lies:
                said.append((INFO, t, bags.calibration(t, camera=replace(CAMERA, fx=48.0, fy=48.0))))
        said = sorted(said + (poses or camera_in_odom)(), key=lambda each: each[1])
        bags.write_bag(folder / "bag", said, storage=bags.StoragePlugin.MCAP)
        return folder / "bag" if change is None else change(folder / "bag")

    return write


def links(parent, child, pose_of, frames=WALK, clock_s=100.0):
    return [("/tf", one.time_s + 100.0, bags.tf(one.time_s + clock_s, parent, child, pose_of(one))) for one in frames]


def camera_in_odom():
    return STATIC + links("odom", "base", bags.base_of)


def moved_x(metres):
    T = np.eye(4)
    T[0, 3] = metres
    return T


def a_step_of_the_map():
    return camera_in_odom() + links("map", "odom", lambda one: moved_x(0.0 if one.step < 6 else 0.5))


def a_slow_localiser():
    """What it corrects, the odometry has wrong."""

    def drift(one):
        return moved_x(0.004 * one.time_s)

    wrong = links("odom", "base", lambda one: np.linalg.inv(drift(one)) @ bags.base_of(one))
    return STATIC + wrong + links("map", "odom", drift, frames=[WALK[0], WALK[3], WALK[6], WALK[9]])


def another_clock():
    return [
        ("/tf_static", 11.0, bags.tf(1.7e9, "base", "optical", bags.T_BASE_CAMERA)),
        *((topic, t - 88.0, m) for topic, t, m in links("odom", "base", bags.base_of, clock_s=1.7e9)),
    ]


def a_fixed_link_once():
    once = [("/tf", 100.0, bags.tf(100.0, "base", "optical", bags.T_BASE_CAMERA))]
    return once + links("odom", "base", bags.base_of)


def without_metadata(folder):
    (folder / "metadata.yaml").unlink()
    return folder


def cut(folder):
    path = next(folder.glob("*.mcap"))
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    return path


FISHEYE = LensDistortion("equidistant", (-0.002, 0.038, -0.036, 0.006))

CASES = (
    Case("b01_per_frame_camera", nerfstudio(per_frame_cameras)),
    Case("b02_calibration_txt", tum(eth3d, walk=WIDE), frames=6),
    Case(
        "b02_my_d435i", tum(walk=WIDE), refused=True, says=("states its camera", "but they have 128 x 72", "--camera")
    ),
    Case("b03_unpadded", replica(unpadded)),
    Case("b04_equidistant", bag(lens=FISHEYE)),
    Case("b05_inf_pose", replica(a_pose_of_infinity), frames=11, says=("1 of 12 frames", "their pose is none")),
    Case("b05_nan_pose", tum(a_line_of_nan), GIVEN, frames=11, says=("1 of 12 lines are no poses",)),
    Case("b06_camera_first", replica(poses=in_first_camera), says=("as if -y pointed up",), mend=("--up=-y",)),
    Case("b06_y_up", replica(poses=lambda T: Y_UP @ T), says=("as if y pointed up",), mend=("--up=y",)),
    Case("b07_gl_axes", gl_axes, says=("the camera axes are RUB (OpenGL)",), mend=("--axes RUB",)),
    Case("b07_inverse", replica(poses=np.linalg.inv), says=("are inverse",), mend=("--poses world-to-camera",)),
    Case("b08_no_scale", replica(poses=without_scale), says=("times what depth says",), mend=("--pose-scale 2.7",)),
    Case("b09_7scenes", plain(layouts.write_seven_scenes), GIVEN),
    Case("b09_polycam", plain(layouts.write_polycam)),
    Case("b09_scannet", plain(layouts.write_scannet)),
    Case("b09_stray", plain(layouts.write_stray)),
    Case("b10_depth_info_lies", bag(lies=True), says=("two calibrations differ", "color/camera_info is taken")),
    Case("b11_step", bag(a_step_of_the_map), jumps=("0.5", "at frame 6")),
    Case("b13_clocks", bag(another_clock, start_s=12.0), refused=True, says=("from 12.000 to", "their clocks differ")),
    Case("b13_slow_localiser", bag(a_slow_localiser), says=("'odom' is stated 4 times", "seldom against 12 times")),
    Case("b14_no_depth", nerfstudio(one_without_depth), frames=11, says=("1 of 12 frames are left out",)),
    Case("b14_windows_ns", nerfstudio(backslashes_json)),
    Case("b14_windows_tum", tum(backslashes), GIVEN),
    Case("n02_npy_mm", nerfstudio(whole_numbers_in_npy)),
    Case("n02_tiff_metres", tum(float_metres), GIVEN),
    Case("n05_blank_in_name", tum(blank_in_names), GIVEN),
    Case("n05_bom", tum(byte_order_mark), GIVEN),
    Case("n05_header_commas", tum(commas_and_a_header), GIVEN),
    Case("n09_slow_poses", tum(poses_between_images), GIVEN),
    Case("n11_no_metadata", bag(change=without_metadata), says=("has no metadata.yaml",)),
    Case("n15_cut_mcap", bag(change=cut), frames=6, says=("ends in the middle",)),
    Case(
        "n16_tenth_mm",
        bag(per_metre=10_000),
        says=("another unit",),
        mend=("--depth-unit 0.0001",),
    ),
    Case("n17_kitti_rows", replica(twelve_numbers)),
    Case("n19_angle", nerfstudio(an_angle_alone)),
    Case("n34_glitch", replica(a_glitch), jumps=("at frame 5", "at frame 6")),
    Case("n37_fixed_link_once", bag(a_fixed_link_once)),
)
