"""Matrices of the kernels: reading and writing them padded, and their product."""

from typing import no_type_check

import triton
import triton.language as tl

# Three products on tensor cores that make one of float32: plain TF32 keeps 10 bits, too few for s near a surface, and
# products outside of tensor cores need ten times the registers.
_PRECISION = tl.constexpr("tf32x3")


@triton.jit
@no_type_check
def tile(pointer, rows, columns, stride, ROWS_PAD: tl.constexpr, COLUMNS_PAD: tl.constexpr):
    """A matrix of ``rows`` x ``columns``, padded with zeros."""
    row = tl.arange(0, ROWS_PAD)[:, None]
    column = tl.arange(0, COLUMNS_PAD)[None, :]
    return tl.load(pointer + row * stride + column, mask=(row < rows) & (column < columns), other=0.0)


@triton.jit
@no_type_check
def store_tile(pointer, value, rows, columns, stride, ROWS_PAD: tl.constexpr, COLUMNS_PAD: tl.constexpr):
    """Writes what of a padded matrix lies within ``rows`` x ``columns``."""
    row = tl.arange(0, ROWS_PAD)[:, None]
    column = tl.arange(0, COLUMNS_PAD)[None, :]
    tl.store(pointer + row * stride + column, value, mask=(row < rows) & (column < columns))


@triton.jit
@no_type_check
def product(a, b):
    """Of "n k" and "k m", to float32's precision."""
    return tl.dot(a, b, input_precision=_PRECISION)
