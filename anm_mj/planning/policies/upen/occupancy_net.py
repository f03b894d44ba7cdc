"""A small U-Net that predicts the unknown part of a planar map; evaluated with numpy alone.

It stands for the occupancy predictor of UPEN (Georgakis et al., ICRA 2022), a ResNet-18 encoder with a U-Net decoder,
with about a hundredth of its weights: three poolings, two 3 x 3 convolutions per stage, and skip connections.
``scripts/train_upen.py`` trains it.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32, Int8
from numpy.lib.stride_tricks import sliding_window_view

from anm_mj.errors import PlanError
from anm_mj.utils.read_file import array_of, read_npz

CLASSES = ("void", "occupied", "free")
"""Classes of a cell: outside or not seen yet; an obstacle; floor."""
VOID, OCCUPIED_CLASS, FREE_CLASS = range(3)
CROP_CELLS = 64
CELL_M = 0.125
"""Edge of a cell [m]. A crop is 8 m wide, as published, with cells 2.5 times as wide."""
WIDTHS = (8, 16, 32, 48)
"""Channels per stage, from fine to coarse."""

Weights = dict[str, Float32[np.ndarray, "..."]]


def layer_shapes() -> Iterator[tuple[str, tuple[int, ...]]]:
    """Name and shape (out, in, 3, 3) of every convolution, in the order of evaluation; each also has ``name.bias``."""
    channels = len(CLASSES)
    for stage, width in enumerate(WIDTHS):
        yield f"down{stage}.0", (width, channels, 3, 3)
        yield f"down{stage}.1", (width, width, 3, 3)
        channels = width
    for stage in reversed(range(len(WIDTHS) - 1)):
        width = WIDTHS[stage]
        yield f"up{stage}.0", (width, channels + width, 3, 3)
        yield f"up{stage}.1", (width, width, 3, 3)
        channels = width
    yield "out", (len(CLASSES), channels, 3, 3)


def load_ensemble(path: Path) -> list[Weights]:
    """The networks of a file that ``scripts/train_upen.py`` wrote. Raises PlanError if the file is missing, or holds
    other layers than :func:`layer_shapes` names.
    """
    if not path.is_file():
        raise PlanError(f"The weights of this policy are not at {path}; make them with scripts/train_upen.py.")
    try:
        stored = read_npz(path)
        num = len(array_of(stored, "out", "f", (None, *dict(layer_shapes())["out"])))
        shapes = [
            (name, shape)
            for layer, kernel in layer_shapes()
            for name, shape in ((layer, kernel), (f"{layer}.bias", kernel[:1]))
        ]
        arrays = {name: array_of(stored, name, "f", (num, *shape)).astype(np.float32) for name, shape in shapes}
    except (OSError, ValueError) as err:
        raise PlanError(f"{path} cannot be read as weights ({err}); make them with scripts/train_upen.py.") from err
    return [{name: values[k] for name, values in arrays.items()} for k in range(num)]


def predict(weights: Weights, classes: Int8[np.ndarray, "rows cols"]) -> Float32[np.ndarray, "3 rows cols"]:
    """Probabilities of the three classes for every cell of a crop.

    ``classes`` are what is known, by index into ``CLASSES``; sides must be multiples of 8.
    """
    hidden = (classes[None] == np.arange(len(CLASSES), dtype=np.int8)[:, None, None]).astype(np.float32)
    kept = []
    for stage in range(len(WIDTHS)):
        if stage:
            kept.append(hidden)
            channels, rows, cols = hidden.shape
            hidden = hidden.reshape(channels, rows // 2, 2, cols // 2, 2).max(axis=(2, 4))
        hidden = _twice(weights, f"down{stage}", hidden)
    for stage in reversed(range(len(WIDTHS) - 1)):
        finer = hidden.repeat(2, axis=1).repeat(2, axis=2)
        hidden = _twice(weights, f"up{stage}", np.concatenate([finer, kept[stage]]))
    logits = _convolve(weights, "out", hidden)
    odds = np.exp(logits - logits.max(axis=0))
    return odds / odds.sum(axis=0)


def _twice(weights: Weights, name: str, hidden: Float[np.ndarray, "c h w"]) -> Float[np.ndarray, "d h w"]:
    for part in ("0", "1"):
        hidden = np.maximum(_convolve(weights, f"{name}.{part}", hidden), 0.0)
    return hidden


def _convolve(weights: Weights, name: str, image: Float[np.ndarray, "c h w"]) -> Float[np.ndarray, "d h w"]:
    windows = sliding_window_view(np.pad(image, ((0, 0), (1, 1), (1, 1))), (3, 3), axis=(1, 2))
    kernel = weights[name]
    rows = windows.transpose(1, 2, 0, 3, 4).reshape(-1, kernel[0].size)
    out = rows @ kernel.reshape(len(kernel), -1).T + weights[f"{name}.bias"]
    return out.T.reshape(len(kernel), *image.shape[1:])
