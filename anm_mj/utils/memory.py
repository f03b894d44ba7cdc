"""Memory that was freed, given back to the system."""

from __future__ import annotations

import ctypes


def return_freed() -> None:
    """Give the system back what this process has freed; does nothing where the C library keeps nothing to give.

    glibc keeps what lies below a block still in use. After work that takes much more than what stays, such as compiling
    a scene, that is hundreds of megabytes.
    """
    try:
        trim = ctypes.CDLL(None).malloc_trim
    except (OSError, AttributeError, TypeError):
        # Not glibc, or no C library to be found this way.
        return
    trim(0)
