"""Adam (Kingma and Ba, ICLR 2015) on flat arrays, as :class:`anm_mj.mapping.backends.adam.Adam` has it."""

from typing import no_type_check

import triton
import triton.language as tl


@triton.jit
@no_type_check
def _adam(parameter, first, second, gradient, step_size, root_bias, BETA1: tl.constexpr, BETA2: tl.constexpr, EPSILON):
    """The new parameter and moments; ``root_bias`` is the root of the second moment's bias."""
    first += (1.0 - BETA1) * (gradient - first)
    second = BETA2 * second + (1.0 - BETA2) * gradient * gradient
    parameter -= step_size * tl.div_rn(first, tl.div_rn(tl.sqrt_rn(second), root_bias) + EPSILON)
    return parameter, first, second


@triton.jit
@no_type_check
def adam_table_kernel(
    rates,
    parameters,
    first,
    second,
    gradient,
    size,
    epsilon,
    BETA1: tl.constexpr,
    BETA2: tl.constexpr,
    BLOCK: tl.constexpr,
):
    """One step of Adam on the table; leaves its gradient zero for the next step.

    All arrays are "size" but ``rates`` ("3"): step sizes of table and decoders, root of the second moment's bias.
    """
    at = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    inside = at < size
    p, m, v = _adam(
        tl.load(parameters + at, mask=inside, other=0.0),
        tl.load(first + at, mask=inside, other=0.0),
        tl.load(second + at, mask=inside, other=0.0),
        tl.load(gradient + at, mask=inside, other=0.0),
        tl.load(rates),
        tl.load(rates + 2),
        BETA1,
        BETA2,
        epsilon,
    )
    tl.store(parameters + at, p, mask=inside)
    tl.store(first + at, m, mask=inside)
    tl.store(second + at, v, mask=inside)
    tl.store(gradient + at, tl.zeros((BLOCK,), tl.float32), mask=inside)


@triton.jit
@no_type_check
def adam_decoders_kernel(
    rates,
    parameters,
    first,
    second,
    partial,
    num_partial,
    size,
    decay,
    epsilon,
    BETA1: tl.constexpr,
    BETA2: tl.constexpr,
    BLOCK: tl.constexpr,
):
    """One step of Adam, with weight decay, on the decoders; sums up the rows of ``partial`` on the way.

    ``partial`` is "num_partial size+4", of which the last four columns are no gradients; the rest as for the table.
    """
    at = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    inside = at < size
    gradient = tl.zeros((BLOCK,), tl.float32)
    for row in range(num_partial):
        gradient += tl.load(partial + row * (size + 4) + at, mask=inside, other=0.0)
    parameter = tl.load(parameters + at, mask=inside, other=0.0)
    p, m, v = _adam(
        parameter,
        tl.load(first + at, mask=inside, other=0.0),
        tl.load(second + at, mask=inside, other=0.0),
        gradient + decay * parameter,
        tl.load(rates + 1),
        tl.load(rates + 2),
        BETA1,
        BETA2,
        epsilon,
    )
    tl.store(parameters + at, p, mask=inside)
    tl.store(first + at, m, mask=inside)
    tl.store(second + at, v, mask=inside)
