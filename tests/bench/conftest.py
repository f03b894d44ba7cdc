import pytest

from tests.bench.fake import POLICIES


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "small.toml"
    path.write_text(f'scenes = ["home"]\npolicies = {POLICIES}\nstarts = 1\nseeds = [0, 1]\nsteps = 300\n')
    return path
