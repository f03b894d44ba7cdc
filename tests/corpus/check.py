"""Runs a case and says what is wrong with what the program did."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image

from tests.corpus.cases import Case, damaged_cases, prepare
from tests.corpus.hostile_cases import hostile_cases
from tests.corpus.runner import content_of, run_case

SECRET_RGB = (251, 1, 249)
"""Colour of the picture that no scene may take from outside its folder."""


def all_cases(good: dict[str, Path], canary: Path, seed: int, per_file: int) -> Iterator[Case]:
    """All cases over these good inputs, one by one; without damage to files if ``per_file`` is 0."""
    yield from hostile_cases(good, canary)
    if per_file:
        yield from damaged_cases(good, seed, per_file)


class Checker:
    """Runs cases in folders of their own, beside things that must stay as they are."""

    def __init__(self, good: dict[str, Path], root: Path) -> None:
        """Make the things that must stay, below ``root``."""
        self._good = good
        self._root = root / "cases"
        self.canary = self._root / "canary"
        self.canary.mkdir(parents=True)
        (self.canary / "precious").write_text("do not write here")
        Image.new("RGB", (64, 64), SECRET_RGB).save(self.canary / "secret.png")
        _import_everything()

    def fault(self, case: Case) -> str:
        """What is wrong with what the program did; nothing if all is well."""
        folder = self._root / "case"
        folder.mkdir()
        try:
            prepare(case, self._good, folder)
            before = content_of(self._root)
            outcome = run_case(list(case.argv), folder)
            fault = outcome.fault()
            if fault:
                return fault
            after = content_of(self._root)
            own = (
                str(folder / "out"),
                str(folder / "room_check.png"),
                str(folder / "out.html"),
                str(folder / "out.png"),
                str(folder / "in" / "run"),
                str(folder / "MUJOCO_LOG"),
            )
            changed = {path for path in before.keys() | after.keys() if before.get(path) != after.get(path)}
            outside = sorted(path for path in changed if not path.startswith(own))
            if outside and "out is" not in case.name:
                return f"changed {', '.join(path[len(str(self._root)) :] for path in outside[:3])}"
            if outcome.status == 2 and (folder / "out").exists() and case.argv[0] == "scene":
                return f"left {sorted(path.name for path in (folder / 'out').iterdir())[:4]}"
            return self._leak(folder / "out")
        finally:
            shutil.rmtree(folder)

    def _leak(self, out: Path) -> str:
        """Whether the picture from outside got into a scene."""
        for path in out.rglob("*.png"):
            try:
                with Image.open(path) as image:
                    colours = np.asarray(image.convert("RGB")).reshape(-1, 3)
            except OSError as err:
                return f"wrote a picture that cannot be read, {path.name} ({err})"
            if (colours == SECRET_RGB).all(axis=1).any():
                return f"took a picture from outside its folder into {path.name}"
        return ""


def _import_everything() -> None:
    """Import what commands need, so that the processes forked from this one start at once."""
    import trimesh
    from skimage import measure, segmentation

    import anm_mj.bench.sweep
    import anm_mj.cli.doctor
    import anm_mj.evaluation.run_evaluation
    import anm_mj.run
    import anm_mj.scene.check
    import anm_mj.scene.importing.import_scene

    del trimesh, measure, segmentation, anm_mj
