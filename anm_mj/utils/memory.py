"""Returns freed memory to the operating system."""

from __future__ import annotations

import ctypes


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
