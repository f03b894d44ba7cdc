import sys
from pathlib import Path

import numpy as np
import pytest

from anm_mj.utils.memory import malloc_trim


def resident_mib() -> float:
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 2**20


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_malloc_trim():
    # Blocks too small for pages of their own, with one in use above them.
    freed = [np.ones(2**13) for _ in range(1500)]
    kept = np.ones(2**13)
    before = resident_mib()
    del freed
    malloc_trim()
    assert resident_mib() < before - 50.0
    assert kept.all()
