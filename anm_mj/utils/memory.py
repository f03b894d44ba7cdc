"""Returns memory to the operating system."""

import contextlib
import ctypes
import mmap
import sys

import numpy as np

_M_ARENA_MAX = -8
"""As glibc numbers it."""
_MADV_DONTNEED = 4
"""As Linux numbers it on all processors."""


def malloc_trim() -> None:
    """Return freed heap memory to the system; does nothing with C libraries other than glibc.

    glibc keeps freed memory below a block still in use. After a high peak, such as compiling a scene, that is
    hundreds of megabytes.
    """
    _call_glibc("malloc_trim", 0)


def use_one_heap() -> None:
    """Let all threads of the process share a heap; does nothing with C libraries other than glibc.

    glibc gives threads heaps of their own, each of which keeps what its thread has freed: tens of megabytes for images.
    Call it before there are threads.
    """
    _call_glibc("mallopt", _M_ARENA_MAX, 1)


def _call_glibc(name: str, *values: int) -> None:
    # It is another library, or its symbols cannot be loaded this way.
    with contextlib.suppress(OSError, AttributeError, TypeError):
        getattr(ctypes.CDLL(None), name)(*values)


def forget_content(array: np.ndarray) -> None:
    """Return the memory of an array that nobody reads any more, though something else still owns it.

    All but its first and last page read as zeros afterwards; does nothing on other systems than Linux. It is
    contiguous, in private memory.
    """
    page = mmap.PAGESIZE
    first = -(-array.ctypes.data // page) * page
    size = (array.ctypes.data + array.nbytes) // page * page - first
    if sys.platform != "linux" or size <= 0:
        return
    ctypes.CDLL(None).madvise(ctypes.c_void_p(first), ctypes.c_size_t(size), _MADV_DONTNEED)
