from collections import defaultdict

import pytest

from anm_mj.bench import comparison
from tests.bench.fake import POLICIES


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "small.toml"
    path.write_text(f'scenes = ["home"]\npolicies = {POLICIES}\nstarts = 1\nseeds = [0, 1]\nsteps = 300\n')
    return path


@pytest.fixture
def no_pictures(monkeypatch):
    """Comparisons write tables alone, which takes a tenth of the time."""
    monkeypatch.setattr(comparison, "_draw", lambda *_: defaultdict(list))
