"""A sample of the corpus; ``scripts/bad_inputs.py`` runs all of it."""

from pathlib import Path

import pytest

from tests.corpus.cases import ROBOT, Case
from tests.corpus.check import Checker, all_cases
from tests.corpus.sources import write_sources


@pytest.fixture(scope="module")
def good(tmp_path_factory) -> dict[str, Path]:
    return write_sources(tmp_path_factory.mktemp("good"), ROBOT)


def faults(good: dict[str, Path], root: Path, keep, seed: int = 0) -> dict[str, str]:
    checker = Checker(good, root)
    cases: list[Case] = [case for case in all_cases(good, checker.canary, seed, 4) if keep(case)]
    assert cases
    found = {case.name: checker.fault(case) for case in cases}
    return {name: fault for name, fault in found.items() if fault}


def test_a_sample_of_bad_files_ends_in_a_sentence(good, tmp_path):
    # Without what drives or renders: each case takes milliseconds.
    quick = ("gltf", "dae", "obj", "ply", "stl", "world", "urdf", "procthor", "houseexpo", "run")
    kept = {kind: 0 for kind in quick}

    def keep(case: Case) -> bool:
        if case.kind not in kept or "doubl" in case.name or "10^9" in case.name or "20,000" in case.name:
            return False
        kept[case.kind] += 1
        return kept[case.kind] % 131 == 1

    assert faults(good, tmp_path, keep) == {}


def test_links_out_of_a_run_folder_are_not_followed(good, tmp_path):
    assert faults(good, tmp_path, lambda case: "curve.csv is a link" in case.name) == {}


@pytest.mark.slow
@pytest.mark.timeout(7200)
def test_the_whole_corpus_ends_in_sentences(good, tmp_path):
    assert faults(good, tmp_path, lambda case: True) == {}
