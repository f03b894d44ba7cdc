"""What the engines that compute with torch tensors share: numpy at the border, queries in chunks, the optimiser."""

from collections.abc import Callable, Iterator

import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor

from anm_mj.errors import MapError
from anm_mj.mapping.backends.backend import MapperBackend
from anm_mj.mapping.backends.parameters import check_shapes
from anm_mj.mapping.mapping_config import MappingConfig, OptimizerConfig

CPU_CHUNK = 8192
"""Points per query on a CPU: the temporaries of so many stay in the second-level cache's reach."""
CUDA_CHUNK = 1 << 18
"""Points per query on a GPU."""


def resolve_device(device: str) -> torch.device:
    """The torch device for "auto", "cpu" or "cuda". Raises MapError if CUDA is asked for and not there."""
    if device == "cuda" and not torch.cuda.is_available():
        raise MapError("The mapping device is 'cuda', but torch finds no CUDA device; use 'auto' or 'cpu'.")
    use_cuda = device == "cuda" or (device == "auto" and torch.cuda.is_available())
    return torch.device("cuda" if use_cuda else "cpu")


class Adam:
    """Adam (Kingma and Ba, ICLR 2015) with an L2 penalty, over groups of parameters with rates of their own.

    It calls torch's fused kernel directly. ``torch.optim`` does the same, but on first use it imports torch's compiler,
    and that loads a second LLVM beside the one of a software GL renderer: in a process that has rendered before, this
    ends in a segmentation fault.
    """

    def __init__(self, config: OptimizerConfig, table: list[Tensor], decoders: list[Tensor]) -> None:
        """Start with empty moments. The penalty is for the decoders' weights, not for the hash table's planes."""
        self._config = config
        self._groups = [
            (_Group(table), config.table_learning_rate, 0.0),
            (_Group(decoders), config.decoder_learning_rate, config.decoder_weight_decay),
        ]

    def zero_grad(self) -> None:
        """Drop all gradients."""
        for group, _, _ in self._groups:
            for parameter in group.parameters:
                parameter.grad = None

    @torch.no_grad()
    def step(self) -> None:
        """Move every parameter that has a gradient."""
        for group, learning_rate, weight_decay in self._groups:
            gradients = {i: p.grad for i, p in enumerate(group.parameters) if p.grad is not None}
            if not gradients:
                continue  # The kernel wants at least one tensor.
            moved = list(gradients)
            num_steps = [group.num_steps[i] for i in moved]
            for count in num_steps:
                count.add_(1)
            torch.ops.aten._fused_adam_.default(
                [group.parameters[i] for i in moved],
                list(gradients.values()),
                [group.first_moments[i] for i in moved],
                [group.second_moments[i] for i in moved],
                [],
                num_steps,
                lr=learning_rate,
                beta1=self._config.beta1,
                beta2=self._config.beta2,
                weight_decay=weight_decay,
                eps=self._config.epsilon,
                amsgrad=False,
                maximize=False,
            )

    def get_state(self) -> dict[str, np.ndarray]:
        """Copies of moments and steps, by group and place."""
        return {name: tensor.detach().cpu().numpy().copy() for name, tensor in self._tensors().items()}

    @torch.no_grad()
    def set_state(self, state: dict[str, np.ndarray]) -> None:
        """Take over what :meth:`get_state` gave. Raises MapError if a name is missing or has another shape."""
        tensors = self._tensors()
        check_shapes(state, {name: tuple(tensor.shape) for name, tensor in tensors.items()})
        for name, tensor in tensors.items():
            tensor.copy_(torch.from_numpy(np.asarray(state[name])))

    def _tensors(self) -> dict[str, Tensor]:
        return {
            f"adam.{number}.{kind}.{place}": tensor
            for number, (group, _, _) in enumerate(self._groups)
            for kind in ("first_moments", "second_moments", "num_steps")
            for place, tensor in enumerate(getattr(group, kind))
        }


class _Group:
    def __init__(self, parameters: list[Tensor]) -> None:
        self.parameters = parameters
        self.first_moments = [torch.zeros_like(p, requires_grad=False) for p in parameters]
        self.second_moments = [torch.zeros_like(p, requires_grad=False) for p in parameters]
        self.num_steps = [torch.zeros((), device=p.device) for p in parameters]


class TensorBackend(MapperBackend):
    """Base of engines that compute with torch tensors on one device."""

    _optimizer: Adam

    def __init__(self, config: MappingConfig, device: str, chunk: int | None = None) -> None:
        """Choose the device. ``device`` is "auto", "cpu" or "cuda"; ``chunk`` are points per query, None = what suits
        the device. Raises MapError if the device is unknown or absent.
        """
        self.config = config
        self._device = resolve_device(device)
        self.device = self._device.type
        self._chunk = chunk or (CUDA_CHUNK if self.device == "cuda" else CPU_CHUNK)

    def _tensor(self, array: Float[np.ndarray, "..."]) -> Float[Tensor, "..."]:
        return torch.from_numpy(np.ascontiguousarray(array, np.float32)).to(self._device)

    def _chunks(self, points_m: Float[np.ndarray, "n 3"]) -> Iterator[tuple[slice, Float[Tensor, "m 3"]]]:
        """Points in pieces, each with its rows."""
        for start in range(0, len(points_m), self._chunk):
            rows = slice(start, start + self._chunk)
            yield rows, self._tensor(points_m[rows])

    def _ask(
        self, points_m: Float[np.ndarray, "n 3"], answer: Callable[[Tensor], Tensor], *width: int
    ) -> Float32[np.ndarray, "n ..."]:
        """What ``answer`` says about each point, in arrays of shape ``width``; asked chunk by chunk."""
        out = np.empty((len(points_m), *width), np.float32)
        for rows, points in self._chunks(points_m):
            out[rows] = answer(points).cpu().numpy()
        return out

    def get_state(self) -> dict[str, np.ndarray]:
        """Parameters, and Adam's moments and steps; see the base class."""
        return {**self.parameters(), **self._optimizer.get_state()}

    def set_state(self, state: dict[str, np.ndarray]) -> None:
        """Take over what :meth:`get_state` gave; see the base class."""
        self.set_parameters(state)
        self._optimizer.set_state(state)
