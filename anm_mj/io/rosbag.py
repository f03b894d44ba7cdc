"""Recordings of a robot: ROS 1 and ROS 2 bags, and MCAP files with ROS 2 messages, through the package rosbags.

Colour, depth, calibration and poses come out of their messages; which topics those are is found by their types, and
said by the user where several fit. Depth has to be registered to the colour image, as drivers publish it on request
(``aligned_depth_to_color``).
"""

import functools
import logging
import weakref
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from anm_mj.errors import RunFolderError
from anm_mj.geometry.lens_distortion import LensDistortion
from anm_mj.io.bag_files import readable_parts
from anm_mj.io.bag_images import colour_image, depth_image, encoding_of, states_metres
from anm_mj.io.bag_limits import limit_rosbags
from anm_mj.io.bag_reader import BagReader, Stamp
from anm_mj.io.sequence import Frame, LeftOut, Sequence, SequenceOptions, from_pixel_centres
from anm_mj.io.sequence_poses import bridged, nearest_index
from anm_mj.types import Intrinsics

_IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
_CALIBRATION = "sensor_msgs/msg/CameraInfo"
_ROLES = ("colour", "depth", "camera", "pose")
"""What a topic can be named for."""

_SAME_CAMERA = 0.01
"""Calibrations whose numbers differ by a smaller share of their image's size tell of one camera."""

_logger = logging.getLogger(__name__)


def read_recording(path: Path, options: SequenceOptions) -> Sequence:
    """Open a recording. Its depth is in millimetres, or metres in floating point, as REP 118 has it, unless the options
    say another unit; the topic of ``pose`` may be ``tf``. Raises RunFolderError if the package rosbags is missing, the
    bag cannot be read, or it does not say where the camera was.
    """
    unknown = [role for role in options.topics if role not in _ROLES]
    if unknown:
        raise RunFolderError(f"There is no role '{unknown[0]}' of a topic; choose from {', '.join(_ROLES)}.")
    reader = open_bag(path)
    try:
        bag = _Bag(path, reader, options)
        # The images are read later; the file is closed with the last of them.
        weakref.finalize(bag, reader.close)
        return bag.sequence()
    except RunFolderError:
        raise
    except Exception as err:
        raise unreadable(path, err) from err


def open_bag(path: Path) -> Any:
    """A ``rosbags.highlevel.AnyReader`` of a bag, opened. Raises RunFolderError if the package rosbags is missing, or
    the bag cannot be read.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as err:
        raise RunFolderError("Bags need the package rosbags: pip install 'anm-mj[ros]'.") from err
    limit_rosbags()
    try:
        # A cut file stands for a path here.
        parts: list[Any] = list(readable_parts(path))
        reader = AnyReader(parts, default_typestore=get_typestore(Stores.ROS2_HUMBLE))
        reader.open()
        return reader
    except Exception as err:
        raise unreadable(path, err) from err


def unreadable(path: Path, err: Exception) -> RunFolderError:
    """Of whatever damaged bytes lead a reader to."""
    return RunFolderError(f"{path} cannot be read as a recording ({str(err) or type(err).__name__}).")


class _Bag(BagReader):
    """Finds camera, images and poses in an open bag."""

    def sequence(self) -> Sequence:
        """The frames of the bag; it stays open for their images."""
        options, match_s = self.options, self.options.match_s
        unit_m = options.depth_unit_m or 0.001
        colour, depth = self._image_topic("colour"), self._image_topic("depth")
        depths, camera_frame = self.stamps(depth)
        colours, colour_frame = self.stamps(colour)
        if _copies(depths) or _copies(colours):
            depths, colours = self._by_recording(depths, colours)
        if colour_frame != camera_frame:
            _logger.warning(
                "%s: depth is of the frame '%s' and colour of '%s'; their pixels are taken for the same ones, as of "
                "depth that is registered to the colour.",
                self.path,
                camera_frame,
                colour_frame,
            )
        intrinsics, distortion = self._intrinsics(colour, depth, camera_frame)
        says_poses = options.needs_poses or (not options.ignores_poses and self.says_poses(camera_frame))
        motion = self.motion(camera_frame) if says_poses else None
        single = {stamp.time_s: stamp for stamp in reversed(depths)}
        pairs = _pairs(sorted(single.values()), colours, match_s)
        if not pairs and depths and colours:
            raise RunFolderError(
                f"No colour image of {self.path} is within {match_s:g} s of a depth image (--match): {depth} has "
                f"stamps {_range([stamp.time_s for stamp in depths])}, {colour} {_range([c.time_s for c in colours])}."
            )
        poses = [None if motion is None else motion.at(depth_stamp.time_s) for depth_stamp, _ in pairs]
        kept = [k for k, T in enumerate(poses) if T is not None or not options.needs_poses]
        why = "no pose of the camera is known at their time"
        if motion is not None and len(kept) < len(pairs):
            lost = next(k for k, T in enumerate(poses) if T is None)
            link = motion.unknown(pairs[lost][0].time_s)
            if link is not None and link.times_s:
                why += (
                    f" (images have stamps {_range([stamp.time_s for stamp, _ in pairs])}; {link.name} is stated "
                    f"{_range(list(link.span_s))}, with gaps of more than {options.max_gap_s:g} s, --max-gap)"
                )
                if link.span_s[0] > pairs[-1][0].time_s or link.span_s[1] < pairs[0][0].time_s:
                    why += ": their clocks differ; record both by one clock"
        # Copies, and images of the faster one of two rates, are not missed.
        copies, alone = len(depths) - len(single), len(single) - len(pairs)
        left_out = (
            LeftOut(copies, len(depths), "their depth has the time of another one", bad=0),
            LeftOut(
                alone,
                len(single),
                f"no colour is within {match_s:g} s of their depth (--match)",
                bad=max(0, alone - max(0, len(single) - len(colours))),
            ),
            LeftOut(len(pairs) - len(kept), len(pairs), why),
        )
        matrices, missing = bridged([pairs[k][0].time_s for k in kept], [poses[k] for k in kept])
        read_depth = functools.partial(depth_image, unit_m=unit_m)
        frames = []
        for k, T in zip(kept, matrices, strict=True):
            stamp, colour_stamp = pairs[k]
            images = self.later(colour, colour_stamp, colour_image), self.later(depth, stamp, read_depth)
            frames.append(Frame(stamp.time_s, *images, T))
        return Sequence(
            self.path,
            intrinsics,
            unit_m,
            tuple(frames),
            resize=True,
            keeps_corner_pixels=options.camera is None and self._is_reduced_by_axis(colour, depth),
            distortion=distortion,
            has_poses=options.needs_poses or len(missing) < len(kept),
            interpolated=missing,
            left_out=left_out,
            reads_metres=states_metres(self.first(depth)),
        )

    def _by_recording(self, depths: list[Stamp], colours: list[Stamp]) -> tuple[list[Stamp], list[Stamp]]:
        """Images whose stamps do not tell most of them apart, by the times of their recording, with a warning. Raises
        RunFolderError if these do not, either.
        """
        words, same = ("depth", depths) if _copies(depths) else ("colour", colours)
        told = _copies(same), len(same), words, self.path
        depths, colours = (
            sorted(stamp._replace(time_s=stamp.at_ns * 1e-9) for stamp in stamps) for stamps in (depths, colours)
        )
        if _copies(depths) or _copies(colours):
            raise RunFolderError(
                "{} of {} {} images of {} have the time of another one, by their stamps and by their recording; record "
                "them with a driver that stamps them.".format(*told)
            )
        text = "%d of %d %s images of %s have the stamp of another one: all are taken at the times of their recording."
        _logger.warning(text, *told)
        return depths, colours

    def _image_topic(self, role: str) -> str:
        """The topic of colour or depth: the one that was named, or the only one whose first image is of that kind."""
        fit = [topic for topic in self.of_type(*_IMAGES) if encoding_of(self.first(topic)) == role]
        # .../image_raw/compressed is the twin of .../image_raw.
        return self.chosen(role, fit, [topic for topic in fit if topic.rpartition("/")[0] not in fit])

    def _intrinsics(self, colour: str, depth: str, camera_frame: str) -> tuple[Intrinsics, LensDistortion | None]:
        """As the bag says. A camera that the user gives has the distortion of the calibration, and its size where that
        has the image's aspect; without one that can be used, it has the image's size and no distortion.
        """
        if self.options.camera is None:
            return self._stated(colour, depth, camera_frame)
        rows, cols = colour_image(self.first(colour)).shape[:2]
        camera = Intrinsics(cols, rows, *self.options.camera)
        there = self.of_type(_CALIBRATION)
        if "camera" in self.options.topics:
            self.chosen("camera", there, [])
        elif not there:
            return camera, None
        try:
            stated, bent = self._stated(colour, depth, camera_frame)
        except Exception as err:
            # Whatever is wrong with the calibration, a damaged message, too, the user's camera stands for it.
            text = "The calibration in %s cannot be used (%s): the given camera stands alone, without lens distortion."
            _logger.warning(text, self.path, err)
            return camera, None
        if cols * stated.height == rows * stated.width:
            camera = replace(camera, width=stated.width, height=stated.height)
        return camera, bent

    def _stated(self, colour: str, depth: str, camera_frame: str) -> tuple[Intrinsics, LensDistortion | None]:
        """Of the calibration beside the depth, or of the only one that has its frame."""
        there, beside = self.of_type(_CALIBRATION), self._beside(depth, colour)
        same = [topic for topic in there if self.first(topic).header.frame_id == camera_frame]
        rectified = is_rectified(depth)
        topic = self._taken_calibration(self.chosen("camera", there, beside[:1] or same), beside, rectified=rectified)
        found = self.first(topic)
        if self.changes(topic):
            raise RunFolderError(
                f"{topic} in {self.path} changes in the course of the bag, but a sequence has one camera; give it by "
                "--camera FX,FY,CX,CY."
            )
        try:
            return calibration(found, topic, rectified=rectified)
        except ValueError as err:
            raise RunFolderError(
                f"{self.path}: {err}; give it by --camera FX,FY,CX,CY, or record rectified images."
            ) from err

    def _beside(self, *images: str) -> list[str]:
        """The calibrations beside topics of images, in their order."""
        there = self.of_type(_CALIBRATION)
        return [topic for each in images for topic in there if topic.rpartition("/")[0] in image_folders(each)]

    def _is_reduced_by_axis(self, colour: str, depth: str) -> bool:
        """Whether colour and depth show all that one camera sees in pixels of different aspect, as the bag of a run."""
        one, other = (self._beside(images)[:1] for images in (depth, colour))
        if not (one and other):
            return False
        mine, theirs = self.first(one[0]), self.first(other[0])
        is_one = _difference(mine, theirs, rectified=is_rectified(depth)) <= _SAME_CAMERA
        return is_one and mine.width * theirs.height != mine.height * theirs.width

    def _taken_calibration(self, topic: str, beside: list[str], *, rectified: bool) -> str:
        """Of calibrations beside depth and colour that differ, that of the colour, where all are of one frame."""
        taken = self.first(topic)
        for other in beside:
            also = self.first(other)
            if _difference(taken, also, rectified=rectified) <= _SAME_CAMERA:
                continue
            mine, theirs = (_pinhole(info, rectified=rectified) for info in (taken, also))
            # Depth in the frame of the colour is registered to it, and seen by its camera.
            is_registered = (taken.header.frame_id, taken.width) == (also.header.frame_id, also.width)
            used, unused = (other, topic) if is_registered and "camera" not in self.options.topics else (topic, other)
            _logger.warning(
                "%s: two calibrations differ, fx, fy, cx, cy = %s px of %s and %s px of %s: %s is taken%s "
                "(--topic camera=%s for the other).",
                self.path,
                _words(mine),
                topic,
                _words(theirs),
                other,
                used,
                ", as depth of the colour's frame is seen by the colour's camera" if used == other else "",
                unused,
            )
            return used
        return topic


def _difference(one: Any, other: Any, *, rectified: bool) -> float:
    """Of the numbers of two calibrations, in shares of the size of their images."""
    mine, theirs = (
        _pinhole(info, rectified=rectified) / np.maximum(np.tile((info.width, info.height), 2), 1)
        for info in (one, other)
    )
    return float(np.abs(mine - theirs).max())


def _words(numbers: Float[np.ndarray, " n"]) -> str:
    return ", ".join(f"{value:.5g}" for value in numbers)


def calibration(info: Any, topic: str, *, rectified: bool) -> tuple[Intrinsics, LensDistortion | None]:
    """The camera of a ``sensor_msgs/CameraInfo`` that images, ``rectified`` or not, are of, and its distortion where
    they are not. Raises ValueError if it is empty, of a part of the image, or of a distortion that is not known.
    """
    fx, fy, cx, cy = _pinhole(info, rectified=rectified).tolist()
    if not (fx > 0.0 and fy > 0.0 and info.width > 0 and info.height > 0):
        raise ValueError(f"the calibration on {topic} is empty")
    region = info.roi
    if (region.width, region.height) not in ((0, 0), (info.width, info.height)):
        raise ValueError(
            f"{topic} says that images are a region of {region.width} x {region.height} pixels of {info.width} x "
            f"{info.height}"
        )
    bent = None
    if not rectified:
        coefficients = np.asarray(info.d if hasattr(info, "d") else info.D, np.float64).tolist()
        bent = LensDistortion.of(info.distortion_model or "plumb_bob", coefficients, f"by {topic}")
    return from_pixel_centres(info.width, info.height, (fx, fy, cx, cy)), bent


def _pinhole(info: Any, *, rectified: bool) -> Float[np.ndarray, "4"]:
    """fx, fy, cx, cy, from the centre of the first pixel [px]."""
    # A bag of ROS 1 has upper-case names.
    k, p = (info.k, info.p) if hasattr(info, "k") else (info.K, info.P)
    # K is of the raw image; who never rectified leaves P at zeros.
    found = (p, [0, 5, 2, 6]) if rectified and p[0] > 0.0 else (k, [0, 4, 2, 5])
    return np.asarray(found[0], np.float64)[found[1]]


def is_rectified(topic: str) -> bool:
    """Whether the name of a topic says that its images, compressed or not, are rectified."""
    return "rect" in topic.removeprefix(image_folders(topic)[-1])


def image_folders(topic: str) -> tuple[str, ...]:
    """Where ``camera_info`` stands beside a topic of images."""
    parent = topic.rpartition("/")[0]
    return (parent, parent.rpartition("/")[0]) if "ompressed" in topic else (parent,)


def _range(times_s: list[float]) -> str:
    return f"from {min(times_s):.3f} to {max(times_s):.3f} s"


def _copies(stamps: list[Stamp]) -> int:
    """Messages with the time of another one, where they are most of them; else 0."""
    copies = len(stamps) - len({stamp.time_s for stamp in stamps})
    return copies if 2 * copies > len(stamps) else 0


def _pairs(depth: list[Stamp], colour: list[Stamp], match_s: float) -> list[tuple[Stamp, Stamp]]:
    """Each depth image with the colour image that is nearest in time; both lists are in order."""
    times_s = [stamp.time_s for stamp in colour]
    nearest = ((stamp, nearest_index(times_s, stamp.time_s, match_s)) for stamp in depth)
    return [(stamp, colour[index]) for stamp, index in nearest if index is not None]
