"""Caches compiled models of large scenes, which take seconds to compile and tenths of a second to load.

The files lie in the user's cache folder and may be deleted at any time. The key covers every input of the model and
MuJoCo's version, whose binary format changes with every release. A file that does not match the checksum in its name
is ignored and replaced.
"""

import hashlib
import logging
import uuid
import zlib
from collections.abc import Callable

import mujoco

from anm_mj.scene.folder import ASSETS, Scene
from anm_mj.utils.files import cache_folder
from anm_mj.utils.read_file import read_bytes

_logger = logging.getLogger(__name__)

CONVERTER_VERSION = 2
"""Version of the conversion: raise it when ``scene.build`` or ``scene.chunks`` begin to build other models."""
MIN_TRIANGLES = 100_000
"""Smaller scenes compile within about a second and are not cached (a file has some hundred megabytes)."""
MAX_MODELS = 4
"""Number of models that are kept, the most recently used."""


def cached_model(scene: Scene, robot_hash: str, prefix: str, build: Callable[[], mujoco.MjModel]) -> mujoco.MjModel:
    """The model that ``build`` makes of a scene and a robot (no ``robot_hash``: none), from the cache if it is there.

    ``prefix`` precedes the names of the robot's elements. Trouble with the cache is logged and otherwise without
    effect; what ``build`` raises goes to the caller.
    """
    if scene.num_triangles < MIN_TRIANGLES:
        return build()
    try:
        key = _key(scene, robot_hash, prefix)
        kept = _load(key)
    # A scene that cannot be read is for build to complain of.
    except (OSError, ValueError) as err:
        _logger.debug("the model cache cannot be used: %s", err)
        return build()
    if kept is not None:
        return kept
    model = build()
    try:
        _store(key, model)
    except OSError as err:
        _logger.debug("the model of %s was not kept: %s", scene.name, err)
    return model


def _key(scene: Scene, robot_hash: str, prefix: str) -> str:
    made_from = (mujoco.__version__, str(CONVERTER_VERSION), scene.hash, robot_hash, prefix)
    digest = hashlib.sha256("\0".join(made_from).encode())
    digest.update(scene.xml.read_bytes())
    # What the files hold, not the hash that scene.toml states: anybody may have written that.
    for path in sorted((scene.folder / ASSETS).iterdir()):
        digest.update(path.name.encode() + b"\0" + hashlib.sha256(read_bytes(path)).digest())
    return digest.hexdigest()[:32]


def _load(key: str) -> mujoco.MjModel | None:
    for path in cache_folder("models").glob(f"{key}-*.mjb"):
        try:
            if f"{zlib.crc32(path.read_bytes()):08x}" == path.stem.rpartition("-")[2]:
                model = mujoco.MjModel.from_binary_path(str(path))
                path.touch()
                return model
        except (ValueError, mujoco.FatalError) as err:
            _logger.debug("%s cannot be loaded: %s", path, err)
        path.unlink(missing_ok=True)
    return None


def _store(key: str, model: mujoco.MjModel) -> None:
    folder = cache_folder("models")
    folder.mkdir(parents=True, exist_ok=True)
    partial = folder / f".{uuid.uuid4().hex}"
    try:
        mujoco.mj_saveModel(model, str(partial))
        # In one step, so that another process never sees half a file.
        partial.replace(folder / f"{key}-{zlib.crc32(partial.read_bytes()):08x}.mjb")
    finally:
        partial.unlink(missing_ok=True)
    for old in sorted(folder.glob("*.mjb"), key=lambda path: path.stat().st_mtime)[:-MAX_MODELS]:
        old.unlink(missing_ok=True)
