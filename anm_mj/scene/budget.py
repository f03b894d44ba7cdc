"""The budget of steps that a scene gets where nobody names one."""

from __future__ import annotations

SMALL_SCENE_ROOMS = 5
"""Scenes up to this many rooms get 1000 steps, larger ones 2000, from 20 rooms on 10,000 (the paper's budgets)."""


def default_steps(rooms: int | None) -> int:
    """The paper's budget for a scene of this many rooms [steps]."""
    if rooms is None or rooms <= SMALL_SCENE_ROOMS:
        return 1000
    return 2000 if rooms < 20 else 10_000
