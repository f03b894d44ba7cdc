"""Returns memory to the operating system."""

import ctypes
import mmap
import sys

import numpy as np

_MADV_DONTNEED = 4
"""As Linux numbers it on all processors."""


def malloc_trim() -> None:
    """Return freed heap memory to the system; does nothing with C libraries other than glibc.

    glibc keeps freed memory below a block still in use. After a high peak, such as compiling a scene, that is
    hundreds of megabytes.
    """
    try:
        trim = ctypes.CDLL(None).malloc_trim
    except (OSError, AttributeError, TypeError):
        # Not glibc, or its symbols cannot be loaded this way.
        return
    trim(0)


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
