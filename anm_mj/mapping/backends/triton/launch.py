"""How kernels are launched: options of the compiler, and sizes of what one program does.

What holds for all kernels of this folder: they compute what the modules of the same names in :mod:`anm_mj.mapping`
say, in float32. Arrays of points are stored by component ("3 n") and features by feature ("features n"), first those of
index 0 of all levels and then those of index 1, so that neighbouring lanes read neighbouring words. Names in capitals
are compile-time constants; ``..._PAD`` is a size rounded up to a power of two, and what lies beyond the size is zero.

Kernels bear ``no_type_check`` because a run-time type checker's wrapper would hide their source from Triton, and their
files do without postponed annotations because Triton reads ``tl.constexpr`` from them.
"""

from __future__ import annotations

from triton import knobs

EXACT = {"enable_fp_fusion": False}
"""Launch option for kernels whose products and sums have to round as the other engines' do."""
FUSED = {"enable_fp_fusion": True}
"""Launch option for all others; said aloud because Triton's default is about to change."""
INTERPRETED: bool = knobs.runtime.interpret
"""Whether Triton's interpreter runs the kernels, on the host: ``TRITON_INTERPRET=1`` was set at import."""
_MIN_PRODUCT = 16
"""Smallest edge of a matrix in Triton's products."""


def block(on_gpu: int, interpreted: int) -> int:
    """What one program does: so much on a GPU, more in the interpreter, where any operation costs about the same."""
    return interpreted if INTERPRETED else on_gpu


def num_blocks(count: int, size: int) -> int:
    """Blocks of ``size`` that ``count`` things take."""
    return -(-count // size)


def padded(size: int) -> int:
    """The next power of two that a matrix product can work on."""
    return max(_MIN_PRODUCT, 1 << (size - 1).bit_length())
