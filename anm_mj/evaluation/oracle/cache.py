"""Tours that were found, kept in the user's cache folder; they may be deleted at any time."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

from anm_mj.evaluation.oracle.tour import Stop
from anm_mj.utils.files import cache_folder, store_in_cache


def load_tour(key: bytes) -> list[Stop] | None:
    """The tour that was stored under a key, or None if there is none, or it is damaged."""
    try:
        stops = json.loads(_path(key).read_text(encoding="utf-8"))
        return [(int(place), int(yaw), int(side)) for place, yaw, side in stops]
    except (OSError, ValueError, TypeError):
        return None


def store_tour(key: bytes, stops: list[Stop]) -> None:
    """Keep a tour; where that cannot be done it is found again the next time."""
    store_in_cache(_path(key), json.dumps(stops).encode())


def _path(key: bytes) -> Path:
    return cache_folder("oracle") / f"{hashlib.sha256(key).hexdigest()[:32]}.json"
