"""A rapidly exploring random tree over the free cells of a map (LaValle, 1998)."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from anm_mj.frames import world_to_cell


@dataclass(frozen=True)
class Tree:
    """Nodes and their parents; node 0 is the root."""

    xy_m: Float[np.ndarray, "n 2"]
    parent: Int[np.ndarray, " n"]
    """-1 for the root."""
    num_hops: Int[np.ndarray, " n"]
    """Edges between each node and the root."""

    def path_to(self, node: int) -> Float[np.ndarray, "k 2"]:
        """The nodes from the root to one of them, both included [m]."""
        chain = [node]
        while self.parent[chain[-1]] >= 0:
            chain.append(int(self.parent[chain[-1]]))
        return self.xy_m[chain[::-1]]


def grow_tree(
    passable: Bool[np.ndarray, "rows cols"],
    origin_xy_m: Float[np.ndarray, "2"],
    resolution_m: float,
    root_xy_m: Float[np.ndarray, "2"],
    *,
    half_width_m: float,
    num_samples: int,
    hop_m: float,
    rng: np.random.Generator,
) -> Tree:
    """A tree grown from the root towards uniform samples of a square about it.

    Edges of length ``hop_m`` cross passable cells only; the root's own cell need not be passable. The origin is the
    outer corner of cell [0, 0].
    """
    xy = np.empty((num_samples + 1, 2))
    parent = np.full(num_samples + 1, -1)
    hops = np.zeros(num_samples + 1, int)
    xy[0], count = root_xy_m, 1
    shares = np.linspace(0.0, 1.0, int(np.ceil(hop_m / resolution_m * 2)) + 1)[1:, None]
    for sample in root_xy_m + rng.uniform(-half_width_m, half_width_m, (num_samples, 2)):
        towards = sample - xy[:count]
        square = np.einsum("ij,ij->i", towards, towards)
        nearest = int(np.argmin(square))
        length = float(np.sqrt(square[nearest]))
        if length < hop_m:
            continue
        end = xy[nearest] + towards[nearest] * (hop_m / length)
        cells = world_to_cell(xy[nearest] + shares * (end - xy[nearest]), origin_xy_m, resolution_m)
        inside = (cells >= 0).all() and (cells < passable.shape).all()
        if inside and passable[cells[:, 0], cells[:, 1]].all():
            xy[count], parent[count], hops[count] = end, nearest, hops[nearest] + 1
            count += 1
    return Tree(xy[:count], parent[:count], hops[:count])
