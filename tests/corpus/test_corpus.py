"""A sample of the corpus; ``scripts/bad_inputs.py`` runs all of it."""

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.corpus.cases import Case
from tests.corpus.check import Checker, all_cases
from tests.corpus.hostile_cases import ROBOT
from tests.corpus.sources import write_sources

EVERY = 150


def faults(good: dict[str, Path], root: Path, keep: Callable[[Case], bool]) -> dict[str, str]:
    """What is wrong with the cases that are kept."""
    checker = Checker(good, root)
    kept = (case for case in all_cases(good, checker.canary, 0, 4) if keep(case))
    found = {case.name: checker.fault(case) for case in kept}
    assert found
    return {name: fault for name, fault in found.items() if fault}


def test_a_sample_of_bad_files_ends_in_a_sentence(tmp_path):
    good = write_sources(tmp_path / "good", ROBOT, with_run=False)
    # Without what drives or renders: each case takes a fraction of a second.
    counts = dict.fromkeys(("gltf", "dae", "obj", "ply", "stl", "world", "urdf", "procthor", "houseexpo"), 0)

    def keep(case: Case) -> bool:
        if case.kind not in counts or any(word in case.name for word in ("doubl", "10^9", "20,000", "3000")):
            return False
        counts[case.kind] += 1
        return counts[case.kind] % EVERY == 1

    assert faults(good, tmp_path, keep) == {}


@pytest.mark.slow
@pytest.mark.timeout(7200)
def test_the_whole_corpus_ends_in_sentences(tmp_path):
    good = write_sources(tmp_path / "good", ROBOT)
    assert faults(good, tmp_path, lambda case: True) == {}
