"""Scenes of others, which are no part of the repository: tests that need them are skipped where they are not named."""

import os
from pathlib import Path

PUBLIC_SCENES = Path(os.environ.get("ANM_MJ_PUBLIC_SCENES") or "no-public-scenes").resolve()
"""Their folder, from the variable ``ANM_MJ_PUBLIC_SCENES``."""
