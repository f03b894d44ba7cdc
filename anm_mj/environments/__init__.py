"""Exploration as a learning environment, for dm_env (:mod:`anm_mj.environments.load`) and Gymnasium.

The import registers ``AnmMj/Explore-v0`` with Gymnasium; it loads neither simulator nor renderer.
"""

import gymnasium

gymnasium.register(id="AnmMj/Explore-v0", entry_point="anm_mj.environments.gym:ExploreEnv")
