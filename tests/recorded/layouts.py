"""Writes a walk as the data sets, apps and programs do whose layouts are read; each as its documentation has it."""

import json

import numpy as np
from PIL import Image
from scipy.spatial.transform import Rotation

from anm_mj.io.own_sequence import SequenceWriter

LIFT_M = 0.7
"""Height of the floor in the worlds of others."""
GL = np.diag([1.0, -1.0, -1.0, 1.0])
Y_UP = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""From a world with z up to one with y up."""
EPOCH_S = 1305031100.0


def lifted(T_world_camera):
    T = T_world_camera.copy()
    T[2, 3] += LIFT_M
    return T


def tum_line(time_s, T):
    values = (*T[:3, 3], *Rotation.from_matrix(T[:3, :3]).as_quat())
    return f"{time_s:.6f} " + " ".join(f"{value:.9f}" for value in values)


def units(depth_m, unit_m):
    """16 bits, 0 where nothing was measured."""
    return np.rint(np.nan_to_num(depth_m, nan=0.0) / unit_m).astype(np.uint16)


def write_images(folder, walk, colour, depth, unit_m, enlarged=1):
    """Colour may be so many times as large as depth."""
    for index, observation in enumerate(walk):
        for name in (colour.format(index), depth.format(index)):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
        rgb = observation.rgb.repeat(enlarged, axis=0).repeat(enlarged, axis=1)
        Image.fromarray(rgb).save(folder / colour.format(index))
        Image.fromarray(units(observation.depth_m, unit_m)).save(folder / depth.format(index))


def write_tum(folder, walk, change=lambda T: T):
    write_images(folder, walk, "rgb/{:d}.png", "depth/{:d}.png", 1 / 5000)
    times = [EPOCH_S + one.time_s for one in walk]
    for kind, comment in (("rgb", "# color images"), ("depth", "# depth maps")):
        lines = [f"{t:.6f} {kind}/{k}.png" for k, t in enumerate(times)]
        (folder / f"{kind}.txt").write_text("\n".join([comment, *lines]) + "\n")
    lines = [tum_line(t, change(lifted(one.T_world_camera))) for t, one in zip(times, walk, strict=True)]
    (folder / "groundtruth.txt").write_text("\n".join(["# timestamp tx ty tz qx qy qz qw", *lines]) + "\n")


def write_nerfstudio(folder, walk):
    write_images(folder, walk, "images/{:03d}.png", "depth/{:03d}.png", 0.001)
    frames = [
        {
            "file_path": f"images/{k:03d}.png",
            "depth_file_path": f"depth/{k:03d}.png",
            "transform_matrix": (lifted(one.T_world_camera) @ GL).tolist(),
        }
        for k, one in enumerate(walk)
    ]
    k = walk[0].intrinsics
    facts = {"w": k.width, "h": k.height, "fl_x": k.fx, "fl_y": k.fy, "cx": k.cx, "cy": k.cy}
    (folder / "transforms.json").write_text(json.dumps(facts | {"frames": frames[::-1]}))


def write_replica(folder, walk, change=lambda T: T):
    write_images(folder, walk, "results/frame{:06d}.jpg", "results/depth{:06d}.png", 1 / 6553.5)
    lines = (" ".join(str(value) for value in change(lifted(one.T_world_camera)).ravel()) for one in walk)
    (folder / "traj.txt").write_text("\n".join(lines) + "\n")
    k = walk[0].intrinsics
    camera = {"w": k.width, "h": k.height, "fx": k.fx, "fy": k.fy, "cx": k.cx - 0.5, "cy": k.cy - 0.5, "scale": 6553.5}
    (folder / "cam_params.json").write_text(json.dumps({"camera": camera}))


def write_seven_scenes(folder, walk):
    write_images(folder, walk, "frame-{:06d}.color.png", "frame-{:06d}.depth.png", 0.001)
    for k, one in enumerate(walk):
        np.savetxt(folder / f"frame-{k:06d}.pose.txt", lifted(one.T_world_camera))


def write_scannet(folder, walk):
    write_images(folder, walk, "color/{:d}.jpg", "depth/{:d}.png", 0.001)
    for name in ("pose", "intrinsic"):
        (folder / name).mkdir()
    for k, one in enumerate(walk):
        np.savetxt(folder / "pose" / f"{k}.txt", lifted(one.T_world_camera))
    np.savetxt(folder / "intrinsic" / "intrinsic_depth.txt", matrix_of(walk[0].intrinsics, size=4))


def write_stray(folder, walk):
    """Colour of three times the size, and confidences from 0 to 2; depth that is not to be believed is wrong."""
    write_images(folder, walk, "rgb/{:06d}.png", "depth/{:06d}.png", 0.001, enlarged=3)
    k = walk[0].intrinsics
    matrix = np.array([[3 * k.fx, 0, 3 * k.cx], [0, 3 * k.fy, 3 * k.cy], [0, 0, 1]])
    np.savetxt(folder / "camera_matrix.csv", matrix, delimiter=", ")
    lines = ["timestamp, frame, x, y, z, qx, qy, qz, qw"]
    for index, one in enumerate(walk):
        T = Y_UP @ one.T_world_camera
        values = (*T[:3, 3], *Rotation.from_matrix(T[:3, :3]).as_quat())
        lines.append(f"{one.time_s:.6f}, {index:06d}, " + ", ".join(f"{value:.9f}" for value in values))
        doubt(folder / "depth" / f"{index:06d}.png", folder / "confidence" / f"{index:06d}.png", (1, 2))
    (folder / "odometry.csv").write_text("\n".join(lines) + "\n")


def doubt(depth, confidence, good):
    """Add wrong depth in the middle, with a confidence of 0; that of the rest has the two values in stripes."""
    stated = np.array(Image.open(depth))
    trust = np.full(stated.shape, good[0], np.uint8)
    trust[:, ::2] = good[1]
    stated[20:24, 30:40], trust[20:24, 30:40] = 200, 0
    Image.fromarray(stated).save(depth)
    confidence.parent.mkdir(exist_ok=True)
    Image.fromarray(trust).save(confidence)


def write_polycam(folder, walk):
    keyframes = folder / "keyframes"
    write_images(keyframes, walk, "images/{:d}.jpg", "depth/{:d}.png", 0.001)
    (keyframes / "cameras").mkdir()
    k = walk[0].intrinsics
    for index, one in enumerate(walk):
        stamp = 166_000_000_000 + round(1e6 * one.time_s)
        T = Y_UP @ one.T_world_camera @ GL
        facts = {f"t_{row}{col}": T[row, col] for row in range(3) for col in range(4)}
        facts |= {"fx": k.fx, "fy": k.fy, "cx": k.cx, "cy": k.cy, "width": k.width, "height": k.height}
        (keyframes / "cameras" / f"{stamp}.json").write_text(
            json.dumps(facts | {"timestamp": stamp, "blur_score": 80.0})
        )
        for kind, suffix in (("images", "jpg"), ("depth", "png")):
            (keyframes / kind / f"{index}.{suffix}").rename(keyframes / kind / f"{stamp}.{suffix}")
        doubt(keyframes / "depth" / f"{stamp}.png", keyframes / "confidence" / f"{stamp}.png", (54, 255))


def write_record3d(folder, walk, save=None):
    """Depth as ``save`` writes it, a function of path and metres; None = NumPy's file."""
    write_images(folder, walk, "rgb/{:d}.jpg", "depth/{:d}.png", 0.001, enlarged=2)
    for index, one in enumerate(walk):
        (folder / "depth" / f"{index}.png").unlink()
        if save is None:
            np.save(folder / "depth" / f"{index}.npy", one.depth_m)
        else:
            save(folder / "depth" / f"{index}.exr", one.depth_m)
    k = walk[0].intrinsics
    poses = [Y_UP @ one.T_world_camera @ GL for one in walk]
    facts = {
        "w": 2 * k.width,
        "h": 2 * k.height,
        "K": [2 * k.fx, 0, 0, 0, 2 * k.fy, 0, 2 * k.cx, 2 * k.cy, 1],
        "fps": 2.5,
        "poses": [[*Rotation.from_matrix(T[:3, :3]).as_quat(), *T[:3, 3]] for T in poses],
    }
    (folder / "metadata.json").write_text(json.dumps(facts))


def write_arkitscenes(folder, walk):
    """Poses of the world in the camera, half way between the images, as they are after the same motion again."""
    write_images(folder, walk, "lowres_wide/{:d}.png", "lowres_depth/{:d}.png", 0.001)
    lines = []
    for name in ("lowres_wide_intrinsics", "confidence"):
        (folder / name).mkdir()
    k = walk[0].intrinsics
    for index, one in enumerate(walk):
        name = f"47_{one.time_s + 100:.3f}"
        for place in ("lowres_wide", "lowres_depth"):
            (folder / place / f"{index}.png").rename(folder / place / f"{name}.png")
        numbers = (k.width, k.height, k.fx, k.fy, k.cx, k.cy)
        (folder / "lowres_wide_intrinsics" / f"{name}.pincam").write_text(" ".join(map(str, numbers)))
        doubt(folder / "lowres_depth" / f"{name}.png", folder / "confidence" / f"{name}.png", (1, 2))
        T = np.linalg.inv(lifted(one.T_world_camera))
        numbers = (*Rotation.from_matrix(T[:3, :3]).as_rotvec(), *T[:3, 3])
        for shift_s in (-0.05, 0.05):
            lines.append(f"{one.time_s + 100 + shift_s:.4f} " + " ".join(f"{value:.9f}" for value in numbers))
    (folder / "lowres_wide.traj").write_text("\n".join(lines) + "\n")


def write_icl(folder, walk):
    """Left-handed: y of the camera points up, and x of the world is mirrored."""
    write_images(folder, walk, "rgb/{:d}.png", "depth/{:d}.png", 1 / 5000)
    lines = [f"{k} depth/{k}.png {k} rgb/{k}.png" for k in range(len(walk))]
    (folder / "associations.txt").write_text("\n".join(lines) + "\n")
    mirror, flip = np.diag([-1.0, 1.0, 1.0, 1.0]), np.diag([1.0, -1.0, 1.0, 1.0])
    lines = [tum_line(k, mirror @ Y_UP @ one.T_world_camera @ flip) for k, one in enumerate(walk)]
    (folder / "livingRoom0.gt.freiburg").write_text("\n".join(lines) + "\n")


def write_open3d(folder, walk):
    """The world is the first camera."""
    write_images(folder, walk, "color/{:05d}.jpg", "depth/{:05d}.png", 0.001)
    first = np.linalg.inv(walk[0].T_world_camera)
    lines = []
    for k, one in enumerate(walk):
        lines += [f"{k} {k} {k + 1}", *(" ".join(map(str, row)) for row in (first @ one.T_world_camera).tolist())]
    (folder / "trajectory.log").write_text("\n".join(lines) + "\n")
    k = walk[0].intrinsics
    facts = {"width": k.width, "height": k.height, "intrinsic_matrix": matrix_of(k).T.ravel().tolist()}
    (folder / "camera_intrinsic.json").write_text(json.dumps(facts))


def write_ours(folder, walk):
    writer = SequenceWriter(folder)
    for observation in walk:
        writer.write(observation)


def matrix_of(camera, size=3):
    """The camera, its principal point measured from the centre of the first pixel."""
    matrix = np.eye(size)
    matrix[[0, 1, 0, 1], [0, 1, 2, 2]] = camera.fx, camera.fy, camera.cx - 0.5, camera.cy - 0.5
    return matrix
