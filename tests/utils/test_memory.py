import platform
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from anm_mj.utils.memory import forget_content, malloc_trim


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


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_forgotten_content():
    whole = np.ones(2**23)
    before = resident_mib()
    forget_content(whole[1:-1])
    assert resident_mib() < before - 60.0
    # What lies beside it stays.
    assert whole[0] == whole[-1] == 1.0
    assert np.count_nonzero(whole) < 2 * 4096


def test_an_array_without_a_whole_page_keeps_its_content():
    few = np.arange(100)
    forget_content(few)
    forget_content(few[:0])
    assert (few == np.arange(100)).all()


_COUNT_HEAPS = """
import ctypes, sys, threading
from pathlib import Path
import numpy as np
from anm_mj.utils.memory import use_one_heap
if sys.argv[2] == "one":
    use_one_heap()
thread = threading.Thread(target=lambda: [np.ones(2**12) for _ in range(100)])
thread.start()
thread.join()
libc = ctypes.CDLL(None)
libc.fopen.restype = ctypes.c_void_p
file = libc.fopen(sys.argv[1].encode(), b"w")
libc.malloc_info(0, ctypes.c_void_p(file))
libc.fclose(ctypes.c_void_p(file))
print(Path(sys.argv[1]).read_text().count("<heap nr="))
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="heaps as glibc has them")
def test_threads_share_a_heap(tmp_path):
    def heaps(how_many: str) -> int:
        command = [sys.executable, "-c", _COUNT_HEAPS, str(tmp_path / "heaps.xml"), how_many]
        return int(subprocess.run(command, capture_output=True, text=True, check=True).stdout)

    assert heaps("many") > heaps("one") == 1
