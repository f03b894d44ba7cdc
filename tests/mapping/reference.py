"""What the engines are compared with: losses and gradients by autograd, in any precision."""

import numpy as np
import torch

from anm_mj.mapping.backends.parameters import DECODER_NAMES
from anm_mj.mapping.backends.torch_backend import TorchBackend
from anm_mj.mapping.backends.torch_field import decode_color, decode_sdf
from anm_mj.mapping.backends.torch_losses import (
    composite,
    ray_losses,
    sdf_to_weight,
    smoothness_lattice,
    smoothness_loss,
)
from anm_mj.mapping.backends.torch_sampling import valid_depth
from anm_mj.mapping.rays import RayBatch


def reference_gradients(backend: TorchBackend, rays: RayBatch, z_m: np.ndarray, dtype: torch.dtype, corner_m=None):
    """Losses and gradients by autograd at the same positions, computed in ``dtype`` from the same float32 corners."""
    config, field = backend.config, backend.field
    leaves = {name: p.detach().to(dtype).requires_grad_() for name, p in field.decoders.items()}
    planes = [p.detach().to(dtype).requires_grad_() for p in field.planes]

    def features(points):
        index, weight = field._grid.corners(points)
        out = torch.stack([(plane[index.long()] * weight.to(dtype)).sum(dim=0) for plane in planes])
        return out.view(-1, len(points)).t()

    def tensor(array):
        return torch.from_numpy(array)

    z = tensor(z_m)
    points = (tensor(rays.origin_m)[:, None] + tensor(rays.direction)[:, None] * z[:, :, None]).view(-1, 3)
    blob = field.encode(points)[1].to(dtype)
    outputs = decode_sdf(leaves, features(points), blob)
    color = decode_color(leaves, blob, outputs[:, 1:])
    s, rgb = outputs[:, 0].view(z.shape), color.view(*z.shape, 3)
    weights = sdf_to_weight(s, z.to(dtype), config.field.truncation_m)
    depth = tensor(rays.depth_m)
    valid = valid_depth(depth, config.sampling)
    terms = ray_losses(
        s,
        z.to(dtype),
        composite(weights, rgb),
        (weights * z.to(dtype)).sum(dim=1),
        tensor(rays.rgb).to(dtype),
        depth.to(dtype),
        valid,
        config.field.truncation_m,
        config.loss,
    )
    smoothness = torch.zeros((), dtype=dtype)
    if corner_m is not None:
        lattice = smoothness_lattice(torch.from_numpy(corner_m.astype(np.float32)), config.loss)
        smoothness = smoothness_loss(features(lattice), config.loss)
    total = terms.total + config.loss.smoothness * smoothness
    total.backward()
    gradients = {"table": np.stack([p.grad.numpy() for p in planes], axis=1)}
    gradients |= {name: leaves[name].grad.numpy() for name in DECODER_NAMES}
    losses = (total, terms.rgb, terms.depth, terms.sdf, terms.free_space, smoothness)
    return [loss.item() for loss in losses], gradients
