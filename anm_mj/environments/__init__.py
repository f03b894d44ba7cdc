"""Exploration as a learning environment, for dm_env (:mod:`anm_mj.environments.load`) and Gymnasium.

The import registers ``AnmMj/Explore-v0`` with Gymnasium; it loads neither simulator nor renderer.
"""

from anm_mj.errors import InstallError
from anm_mj.utils.extras import missing_package

try:
    import gymnasium
except ModuleNotFoundError as err:
    raise InstallError(missing_package(err) or str(err)) from err

gymnasium.register(id="AnmMj/Explore-v0", entry_point="anm_mj.environments.gym:ExploreEnv")
