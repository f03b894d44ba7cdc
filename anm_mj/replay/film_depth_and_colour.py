"""The upper pictures of a film's frame: what the camera saw, in colour and as depth in colours."""

from functools import lru_cache
from pathlib import Path

import matplotlib
import numpy as np
from jaxtyping import Float, UInt8, UInt16
from PIL import Image, ImageColor, ImageDraw, ImageFont

from anm_mj.io.run_records import FrameRecord
from anm_mj.types import Intrinsics
from anm_mj.viz import palette

PANEL_PX = 480
TARGET_HEIGHT_M = 0.4
"""Height of the mark of a target in the colour image [m]."""
NEAR_M = 0.05


@lru_cache
def font(size_px: int) -> ImageFont.FreeTypeFont:
    """Matplotlib's own font, so that film and figures look alike."""
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"), size_px)


def empty_panel(text: str, background: str) -> Image.Image:
    """Words in the place of a picture."""
    panel = Image.new("RGB", (PANEL_PX, PANEL_PX), background)
    ImageDraw.Draw(panel).text((PANEL_PX // 2, PANEL_PX // 2), text, "#5d6570", font(18), anchor="mm")
    return panel


def colour_panel(
    rgb: UInt8[np.ndarray, "h w 3"] | None,
    frame: FrameRecord,
    intrinsics: Intrinsics,
    target_xy_m: Float[np.ndarray, "2"] | None,
) -> Image.Image:
    """The camera's picture with a pin at the target; grey where there is no picture."""
    if rgb is None:
        return empty_panel("no colour images", "#cdd2d8")
    panel, scale, corner = _fitted(Image.fromarray(rgb), intrinsics)
    if target_xy_m is not None:
        foot, head = (
            _pixel(np.array([*target_xy_m, z]), frame.T_world_camera, intrinsics) for z in (0.0, TARGET_HEIGHT_M)
        )
        if foot is not None and head is not None:
            pin = [tuple(end * scale + corner) for end in (foot, head)]
            draw = ImageDraw.Draw(panel)
            draw.line(pin, "white", 5)
            draw.line(pin, palette.TARGET, 3)
            draw.circle(pin[1], 8, palette.TARGET, "white", 2)
    return panel


def depth_panel(depth_mm: UInt16[np.ndarray, "rows cols"], far_m: float, intrinsics: Intrinsics) -> Image.Image:
    """Depth in colours from 0 (dark) to ``far_m``, grey where there is none, with its scale."""
    level = np.rint(np.clip(depth_mm / (1000.0 * far_m), 0.0, 1.0) * 255.0).astype(np.uint8)
    image = _depth_table()[level]
    image[depth_mm == 0] = ImageColor.getrgb("#9aa0a6")
    panel, _, _ = _fitted(Image.fromarray(image), intrinsics, Image.Resampling.NEAREST)
    draw = ImageDraw.Draw(panel)
    strip = Image.fromarray(np.tile(_depth_table()[None, ::-1].transpose(1, 0, 2), (1, 12, 1)))
    left, top = PANEL_PX - 62, PANEL_PX - 276
    draw.rounded_rectangle([left - 8, top - 12, PANEL_PX - 6, PANEL_PX - 8], 5, "white")
    panel.paste(strip, (left, top))
    for share in (0.0, 0.5, 1.0):
        draw.text((left + 17, top + 255 * (1.0 - share)), f"{far_m * share:g} m", "black", font(13), anchor="lm")
    return panel


def _pixel(
    point_m: Float[np.ndarray, "3"], T_world_camera: Float[np.ndarray, "4 4"], intrinsics: Intrinsics
) -> Float[np.ndarray, "2"] | None:
    """Where a world point lies in the image [px]; None behind the camera."""
    x, y, z = T_world_camera[:3, :3].T @ (point_m - T_world_camera[:3, 3])
    if z < NEAR_M:
        return None
    return np.array([intrinsics.fx * x / z + intrinsics.cx, intrinsics.fy * y / z + intrinsics.cy])


def _fitted(
    image: Image.Image, intrinsics: Intrinsics, resample: Image.Resampling = Image.Resampling.BICUBIC
) -> tuple[Image.Image, float, np.ndarray]:
    """An image scaled into a panel; the scale from pixels of the original image, and where its corner went."""
    scale = PANEL_PX / max(intrinsics.width, intrinsics.height)
    size = (round(intrinsics.width * scale), round(intrinsics.height * scale))
    corner = ((PANEL_PX - size[0]) // 2, (PANEL_PX - size[1]) // 2)
    panel = Image.new("RGB", (PANEL_PX, PANEL_PX), "#23262b")
    panel.paste(image.resize(size, resample), corner)
    return panel, scale, np.array(corner, float)


@lru_cache
def _depth_table() -> UInt8[np.ndarray, "256 3"]:
    return np.rint(255.0 * matplotlib.colormaps["turbo"](np.arange(256))[:, :3]).astype(np.uint8)
