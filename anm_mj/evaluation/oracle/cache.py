"""Tours that were found, kept in the user's cache folder; they may be deleted at any time."""

from __future__ import annotations

import hashlib
import json
import logging
import uuid
from pathlib import Path

from anm_mj.evaluation.ground_truth_cache import cache_folder
from anm_mj.evaluation.oracle.tour import Stop

_logger = logging.getLogger(__name__)


def load_tour(key: bytes) -> list[Stop] | None:
    """The tour that was stored under a key, or None if there is none, or it is damaged."""
    try:
        stops = json.loads(_path(key).read_text(encoding="utf-8"))
        return [(int(place), int(yaw), int(side)) for place, yaw, side in stops]
    except (OSError, ValueError, TypeError):
        return None


def store_tour(key: bytes, stops: list[Stop]) -> None:
    """Keep a tour; where that cannot be done it is found again the next time."""
    path = _path(key)
    unfinished = path.with_name(f"{path.stem}-{uuid.uuid4().hex}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        unfinished.write_text(json.dumps(stops), encoding="utf-8")
        unfinished.replace(path)
    except OSError as err:
        _logger.debug("the tour was not kept: %s", err)
        unfinished.unlink(missing_ok=True)


def _path(key: bytes) -> Path:
    return cache_folder().parent / "oracle" / f"{hashlib.sha256(key).hexdigest()[:32]}.json"
