"""Shapes of the lines and objects in a run folder, which anybody may have written; numbers are finite."""

from datetime import datetime
from typing import Annotated, Any

from msgspec import Meta, Struct

Number = Annotated[float, Meta(ge=-1e12, le=1e12)]
Length = Annotated[float, Meta(ge=-1e6, le=1e6)]
"""A coordinate [m]."""
Count = Annotated[int, Meta(ge=0, le=10**9)]
Pixels = Annotated[int, Meta(ge=1, le=16384)]
Row = tuple[Number, Number, Number, Number]


class PoseShape(Struct):
    """A pose of the robot and of its camera."""

    x_m: Length
    y_m: Length
    yaw_rad: Number
    T_world_camera: tuple[Row, Row, Row, Row]


class LocalisationShape(Struct):
    """What localisation said of a frame, as far as it is read again."""

    state: str
    usable: bool
    closes_loop: bool = False
    covariance_xy_m2: tuple[Number, Number, Number] | None = None


class FrameShape(PoseShape):
    """A line of ``frames.jsonl``; :class:`~anm_mj.io.run_records.FrameRecord` says what its parts are."""

    step: Count
    time_s: Number
    image_age_s: Number = 0.0
    """Only of late images."""
    true: PoseShape | None = None
    """Only where it differs from the believed one."""
    people: list[tuple[Length, Length, Number, Number, Number]] = []
    chair: tuple[Length, Length, Number] | None = None
    vacuums: list[tuple[Length, Length, Number]] = []
    doors: list[tuple[Length, Length, Number, Length]] = []
    localisation: LocalisationShape | None = None
    """Only where the pose was estimated."""


class StepShape(Struct):
    """A line of ``steps.jsonl``."""

    step: Count
    action: str
    """Name of an :class:`~anm_mj.types.Action`."""
    x_m: Length
    y_m: Length
    yaw_rad: Number
    collided: bool
    moved_m: Length
    left_radps: Number
    right_radps: Number
    ms: dict[str, Annotated[float, Meta(ge=0.0, le=1e12)]]
    """Wall time by stage [ms]."""


class IntrinsicsShape(Struct):
    """A pinhole camera."""

    width: Pixels
    height: Pixels
    fx: Annotated[float, Meta(gt=0.0, le=1e6)]
    fy: Annotated[float, Meta(gt=0.0, le=1e6)]
    cx: Number
    cy: Number


class DepthShape(Struct):
    """Size of the reduced depth images."""

    rows: Pixels
    cols: Pixels


class CameraShape(Struct):
    """``camera.json``."""

    intrinsics: IntrinsicsShape
    depth: DepthShape


class PlanShape(Struct):
    """A line of ``plans.jsonl``, as far as others read it."""

    step: Count
    reason: str = ""
    target_xy_m: tuple[Length, Length] | None = None


class FootprintShape(Struct):
    """The space that the robot sweeps."""

    radius_m: Annotated[float, Meta(gt=0.0, le=1e3)]
    z_min_m: Length
    z_max_m: Length


class ManifestShape(Struct):
    """``manifest.json``, as far as others read it."""

    scene: str = ""
    scene_hash: str = ""
    robot: str = ""
    robot_hash: str = ""
    footprint: FootprintShape | None = None
    policy: str = ""
    started: Annotated[datetime, Meta(tz=True)] | None = None
    continued_from: dict[str, Any] | None = None
    git: dict[str, Any] | None = None


class SensorShape(Struct):
    """Settings of the sensor in ``config.json`` that others read."""

    max_range_m: Annotated[float, Meta(ge=0.0, le=1e6)] = 0.0


class ConfigShape(Struct):
    """``config.json``, as far as others read it without the settings' own types."""

    robot: str = ""
    sensor: SensorShape | None = None
    camera: dict[str, Any] = {}
    model: dict[str, Any] = {}
