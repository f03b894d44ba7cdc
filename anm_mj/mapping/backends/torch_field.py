"""The neural field: world point to signed distance and colour (paper, Eq. 8).

Its parameters are those of :mod:`anm_mj.mapping.backends.parameters`. There are no biases. ``s`` is a fraction of the
truncation distance: 1 in free space, 0 on the surface.
"""

from collections.abc import Mapping, Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from anm_mj.mapping.backends.parameters import DECODER_NAMES, initial_parameters
from anm_mj.mapping.backends.torch_encoding import HashGrid, one_blob
from anm_mj.mapping.mapping_config import FieldConfig


class TorchField(torch.nn.Module):
    """Hash grid, one-blob code and two shallow decoders (Wang et al., Co-SLAM, 2023), in torch.

    The table is kept as one plane per feature, because gathering one float at a time is what a CPU does well.
    """

    def __init__(self, config: FieldConfig, seed: int, device: torch.device) -> None:
        super().__init__()
        self.config = config
        self._grid = HashGrid(config, device)
        self._period_m = torch.tensor(config.blob_period_m, device=device)
        arrays = initial_parameters(config, seed)
        self.planes = torch.nn.ParameterList([torch.from_numpy(p.copy()).to(device) for p in arrays["table"].T])
        self._decoders = torch.nn.ParameterList([torch.from_numpy(arrays[n]).to(device) for n in DECODER_NAMES])

    @property
    def decoders(self) -> dict[str, torch.nn.Parameter]:
        """The decoders' weights by name, in the order of the parameter layout."""
        return dict(zip(DECODER_NAMES, self._decoders, strict=True))

    def encode(self, points_m: Float[Tensor, "n 3"]) -> tuple[Float[Tensor, "n features"], Float[Tensor, "n blob"]]:
        """Grid features and one-blob code of world points [m]."""
        blob = one_blob(points_m, self._period_m.to(points_m.dtype), self.config.blob_bins)
        return self.grid_features(points_m), blob

    def grid_features(self, points_m: Float[Tensor, "n 3"]) -> Float[Tensor, "n features"]:
        """Grid features alone, for the smoothness term."""
        return self._grid.features(points_m, *self.planes)


def decode_sdf(
    decoders: Mapping[str, Tensor], features: Float[Tensor, "n features"], blob: Float[Tensor, "n blob"]
) -> Float[Tensor, "n outputs"]:
    """The SDF decoder with given weights: s in column 0, and the geometry features in the others."""
    return sdf_hidden(decoders["sdf_hidden"], features, blob) @ decoders["sdf_out"].t()


def sdf_hidden(
    hidden: Float[Tensor, "hidden inputs"], features: Float[Tensor, "n features"], blob: Float[Tensor, "n blob"]
) -> Float[Tensor, "n hidden"]:
    """The hidden layer of the SDF decoder with given weights."""
    # Two products instead of one on joined inputs: joining would copy them, at a tenth of a training step's cost.
    split = features.shape[1]
    return torch.relu(torch.addmm(features @ hidden[:, :split].t(), blob, hidden[:, split:].t()))


def decode_color(
    decoders: Mapping[str, Tensor], blob: Float[Tensor, "n blob"], geometry: Float[Tensor, "n geometry"]
) -> Float[Tensor, "n 3"]:
    """The colour decoder with given weights: red, green, blue in [0, 1], which the sigmoid keeps them in."""
    hidden, split = decoders["color_hidden"], blob.shape[1]
    joined = torch.addmm(blob @ hidden[:, :split].t(), geometry, hidden[:, split:].t())
    return torch.sigmoid(torch.relu(joined) @ decoders["color_out"].t())


def sensitivity(
    decoders: Sequence[Float[Tensor, "_ _"]], features: Float[Tensor, "n features"], blob: Float[Tensor, "n blob"]
) -> tuple[Float[Tensor, " n"], Float[Tensor, " n"]]:
    """Squared norms of the gradients by all decoder weights, of s and of the colour (mean of the three channels). Each
    layer's weight gradient is an outer product, so its squared norm is a product of two squared norms and no gradient
    has to be formed. ``decoders`` are in the order of the parameter layout.
    """
    in_sdf, out_sdf, in_color, out_color = decoders
    geometry_columns = in_color[:, blob.shape[1] :]
    sdf_input = torch.cat((features, blob), dim=1)
    hidden = torch.relu(sdf_input @ in_sdf.t())
    active = hidden > 0.0
    outputs = hidden @ out_sdf.t()
    input_norm, hidden_norm = _square_norm(sdf_input), _square_norm(hidden)
    of_s = hidden_norm + _square_norm(active * out_sdf[0]) * input_norm
    color_input = torch.cat((blob, outputs[:, 1:]), dim=1)
    color_hid = torch.relu(color_input @ in_color.t())
    color = torch.sigmoid(color_hid @ out_color.t())
    total = torch.zeros_like(input_norm)
    for channel in range(3):
        back_color = (color_hid > 0.0) * out_color[channel]
        back_geometry = back_color @ geometry_columns
        back_hidden = active * (back_geometry @ out_sdf[1:])
        squares = _square_norm(color_hid) + _square_norm(back_color) * _square_norm(color_input)
        squares += _square_norm(back_geometry) * hidden_norm + _square_norm(back_hidden) * input_norm
        slope = color[:, channel] * (1.0 - color[:, channel])
        total += slope.square() * squares
    return of_s, total / 3.0


def _square_norm(rows: Float[Tensor, "n width"]) -> Float[Tensor, " n"]:
    return rows.square().sum(dim=1)
