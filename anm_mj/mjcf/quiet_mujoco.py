"""Keeps MuJoCo's warnings where the program's own are."""

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

_logger = logging.getLogger(__name__)


@contextmanager
def quiet_mujoco() -> Iterator[None]:
    """Keep MuJoCo's warnings from the terminal, and from MUJOCO_LOG.TXT in the current folder."""
    import mujoco

    mujoco.set_mju_user_warning(lambda text: _logger.debug("MuJoCo: %s", text))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        mujoco.set_mju_user_warning(None)
