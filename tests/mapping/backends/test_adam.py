import subprocess
import sys

import pytest
import torch

from anm_mj.mapping.backends.tensor_backend import Adam
from anm_mj.mapping.mapping_config import OptimizerConfig


def grown(optimise):
    torch.manual_seed(0)
    parameters = [torch.randn(7, 2, requires_grad=True), torch.randn(3, requires_grad=True)]
    step = optimise(parameters)
    for i in range(20):
        (parameters[0].sin().sum() * (i + 1) + (parameters[1] ** 2).sum()).backward()
        step()
        for parameter in parameters:
            parameter.grad = None
    return parameters


def ours(parameters):
    return Adam(OptimizerConfig(), parameters[:1], parameters[1:]).step


def torchs(parameters):
    cfg = OptimizerConfig()
    groups = [
        {"params": parameters[:1], "lr": cfg.table_learning_rate, "weight_decay": 0.0},
        {"params": parameters[1:], "lr": cfg.decoder_learning_rate, "weight_decay": cfg.decoder_weight_decay},
    ]
    return torch.optim.Adam(groups, betas=(cfg.beta1, cfg.beta2), eps=cfg.epsilon, fused=True).step


@pytest.mark.slow
def test_it_takes_the_same_steps_as_torchs_own_bit_for_bit():
    # In a process of its own: torch.optim loads a compiler that does not stand beside a software renderer.
    code = (
        "import torch; from tests.mapping.backends.test_adam import grown, ours, torchs; "
        "assert all(torch.equal(a, b) for a, b in zip(grown(ours), grown(torchs)))"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_training_loads_no_compiler_whose_llvm_would_clash_with_a_software_renderer():
    code = (
        "import sys; import numpy as np\n"
        "from anm_mj.mapping.backends.torch_backend import TorchBackend\n"
        "from anm_mj.mapping.backends.backend import RayBatch\n"
        "from anm_mj.mapping.mapping_config import quick_mapping\n"
        "ones = np.ones((8, 3), np.float32)\n"
        "rays = RayBatch(0 * ones, ones, ones, np.ones(8, np.float32))\n"
        "TorchBackend(quick_mapping(), seed=0, device='cpu').step(rays, 0)\n"
        "print([name for name in ('triton', 'torch._dynamo') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout.strip() == "[]"
