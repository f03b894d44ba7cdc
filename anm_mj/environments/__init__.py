"""Exploration as an environment to learn in: by dm_env (:mod:`anm_mj.environments.load`) and by Gymnasium.

Importing this package registers ``AnmMj/Explore-v0`` with Gymnasium; it loads neither simulator nor renderer.
"""

import gymnasium

gymnasium.register(id="AnmMj/Explore-v0", entry_point="anm_mj.environments.gym:ExploreEnv")
