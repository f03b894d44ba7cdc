"""Compiles the Triton engine's kernels for a Hopper GPU, which need not be there; prints what came out, as JSON.

In a process of its own for the same reason as ``triton_parity``, and because the kernels must not be interpreted.
"""

import json
import sys
from dataclasses import replace

import numpy as np
import torch
import triton
from triton.backends.compiler import GPUTarget
from triton.compiler import ASTSource

from anm_mj.mapping.backends.triton import backend as triton_backend
from anm_mj.mapping.backends.triton import field, training_step
from anm_mj.mapping.config import default_mapping
from anm_mj.mapping.rays import RayBatch

TARGET = GPUTarget("cuda", 90, 32)
KERNELS = {
    field: ("encode_kernel", "scatter_kernel", "decode_kernel"),
    training_step: ("sample_kernel", "train_kernel", "adam_table_kernel", "adam_decoders_kernel"),
}
"""Where kernels are launched from."""
OPTIONS = ("enable_fp_fusion", "num_stages")
TYPES = {torch.float32: "*fp32", torch.int32: "*i32", float: "fp32", int: "i32"}


class Recorder:
    """Stands in for a kernel and keeps what it is launched with."""

    def __init__(self, kernel):
        self.kernel = kernel
        self.arguments = {}

    def __getitem__(self, grid):
        def launch(*args, **kwargs):
            self.arguments = {**dict(zip(self.kernel.arg_names, args, strict=False)), **kwargs}

        return launch

    def compile(self):
        """The kernel for the target, with the types and constants of the last launch."""
        signature, constants, attributes = {}, {}, {}
        for position, parameter in enumerate(self.kernel.params):
            value = self.arguments[parameter.name]
            if parameter.is_constexpr:
                signature[parameter.name] = "constexpr"
                constants[(position,)] = value
            else:
                is_array = isinstance(value, torch.Tensor)
                signature[parameter.name] = TYPES[value.dtype if is_array else type(value)]
                # What a launch finds out by itself; vector instructions depend on it.
                if (isinstance(value, int) and value % 16 == 0) or (is_array and value.data_ptr() % 16 == 0):
                    attributes[(position,)] = [["tt.divisibility", 16]]
        options = {name: self.arguments[name] for name in OPTIONS if name in self.arguments}
        source = ASTSource(self.kernel, signature, constants, attributes)
        return triton.compile(source, target=TARGET, options=options)


def main() -> None:
    torch.set_num_threads(1)
    # The interpreter's way through the engine needs no GPU; the sizes are a GPU's.
    triton_backend.INTERPRETED = True
    recorders = {}
    for module, names in KERNELS.items():
        for name in names:
            recorders[name] = Recorder(getattr(module, name))
            setattr(module, name, recorders[name])
    config = default_mapping()
    # Small layers, because compiling takes as long as they are wide.
    small = replace(config.field, num_levels=4, log2_table_size=9, blob_bins=5, hidden_width=16, geometry_features=7)
    backend = triton_backend.TritonBackend(replace(config, field=small), seed=0, device="cpu")
    ray = np.ones((1, 3), np.float32)
    backend.step(RayBatch(ray, ray, ray, np.ones(1, np.float32)), 0)
    backend.query_rgb(ray)
    found = {}
    for name, recorder in recorders.items():
        code = recorder.compile().asm
        assert code["cubin"]
        found[name] = {"paired_atomics": "add.v2.f32" in code["ptx"]}
    json.dump(found, sys.stdout)


if __name__ == "__main__":
    main()
