"""Adam by torch's fused kernel, called directly.

``torch.optim`` does the same, but on first use it imports torch's compiler, and that loads a second LLVM beside the one
of a software GL renderer: in a process that has rendered before, this ends in a segmentation fault.
"""

import numpy as np
import torch

from anm_mj.mapping.backends.parameters import check_shapes
from anm_mj.mapping.mapping_config import OptimizerConfig


class Adam:
    """Adam (Kingma and Ba, ICLR 2015) with an L2 penalty, over groups of parameters with rates of their own."""

    def __init__(self, config: OptimizerConfig, table: list[torch.Tensor], decoders: list[torch.Tensor]) -> None:
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

    def _tensors(self) -> dict[str, torch.Tensor]:
        return {
            f"adam.{number}.{kind}.{place}": tensor
            for number, (group, _, _) in enumerate(self._groups)
            for kind in ("first_moments", "second_moments", "num_steps")
            for place, tensor in enumerate(getattr(group, kind))
        }


class _Group:
    def __init__(self, parameters: list[torch.Tensor]) -> None:
        self.parameters = parameters
        self.first_moments = [torch.zeros_like(p, requires_grad=False) for p in parameters]
        self.second_moments = [torch.zeros_like(p, requires_grad=False) for p in parameters]
        self.num_steps = [torch.zeros((), device=p.device) for p in parameters]
