"""How well an uncertainty predicts the error it stands for: the area under the sparsification error curve.

Points are removed from the most uncertain on, and the mean error of those that remain is followed (the sparsification
curve); removing by the error itself gives the best curve there can be. The area between the two is zero for a perfect
ranking (AUSE; Ilg et al., Uncertainty Estimates and Multi-Hypotheses Networks for Optical Flow, ECCV 2018, section 4).
Only the order of the uncertainties counts, so any positive scale will do.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.stats import rankdata


def sparsification_curve(
    error: Float[np.ndarray, " n"], removed_first: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """Mean error of what remains after removing 0, 1, ..., n - 1 points.

    Args:
        error: Error of each point, in any unit.
        removed_first: The larger, the earlier a point goes. Equal ones are each given their group's mean error, so that
            the curve is the mean over all orders within the group.
    """
    order = np.argsort(removed_first, kind="stable")
    _, group = np.unique(removed_first[order], return_inverse=True)
    group_mean = np.bincount(group, error[order]) / np.bincount(group)
    remaining = np.cumsum(group_mean[group]) / np.arange(1, len(error) + 1)
    return remaining[::-1]


def area_under_sparsification_error(error: Float[np.ndarray, " n"], uncertainty: Float[np.ndarray, " n"]) -> float:
    """Area between the sparsification curve of an uncertainty and that of the error itself, in the error's unit.

    0 for a perfect ranking; see :func:`relative_area` for a number that is 1 for a random one.
    """
    uncertain = sparsification_curve(error, uncertainty)
    return float(np.mean(uncertain - sparsification_curve(error, error)))


def relative_area(error: Float[np.ndarray, " n"], uncertainty: Float[np.ndarray, " n"]) -> float:
    """The area as a share of what ranking at random leaves: 0 perfect, 1 no better than chance, above 1 worse.

    0 where all errors are equal, since every ranking is then as good as the best.
    """
    by_chance = float(np.mean(error) - np.mean(sparsification_curve(error, error)))
    return area_under_sparsification_error(error, uncertainty) / by_chance if by_chance > 0.0 else 0.0


def rank_correlation(a: Float[np.ndarray, " n"], b: Float[np.ndarray, " n"]) -> float:
    """Spearman's rank correlation, in [-1, 1]; NaN where either is constant."""
    ranks = np.stack([rankdata(a), rankdata(b)])
    if (np.ptp(ranks, axis=1) == 0.0).any():
        return float("nan")
    return float(np.corrcoef(ranks)[0, 1])
