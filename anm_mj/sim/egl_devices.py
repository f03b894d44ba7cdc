"""Program: prints the EGL devices as JSON: the CUDA device that each is, or null, and the one that draws.

``CUDA_VISIBLE_DEVICES`` says on which GPU torch computes. EGL does not read it: MuJoCo draws on the first device that
opens, or on that of ``MUJOCO_EGL_DEVICE_ID``. Source: EGL_EXT_device_query and EGL_NV_device_cuda (Khronos).
"""

import ctypes
import json
import os
import sys
from collections.abc import Callable
from typing import Any

_CUDA_DEVICE = 0x323A
_PLATFORM_DEVICE = 0x313F
_MOST = 64


def main() -> None:
    """Write ``[[cuda or null, ...], drawing or null]`` to standard output; raises OSError without EGL."""
    egl = ctypes.CDLL("libEGL.so.1")
    egl.eglGetProcAddress.restype = ctypes.c_void_p
    pointers, number = ctypes.POINTER(ctypes.c_void_p), ctypes.POINTER(ctypes.c_int)
    query = _function(egl, b"eglQueryDevicesEXT", ctypes.c_uint, ctypes.c_int, pointers, number)
    devices, count = (ctypes.c_void_p * _MOST)(), ctypes.c_int()
    query(_MOST, devices, ctypes.byref(count))
    wanted = os.environ.get("MUJOCO_EGL_DEVICE_ID")
    found = devices[: count.value]
    tried = range(len(found)) if wanted is None else [int(wanted)]
    drawing = next((k for k in tried if k in range(len(found)) and _opens(egl, found[k])), None)
    json.dump([[_cuda_device(egl, device) for device in found], drawing], sys.stdout)


def _function(egl: ctypes.CDLL, name: bytes, *types: type) -> Callable[..., Any]:
    """A function of an extension; the first type is that of its result."""
    address = egl.eglGetProcAddress(name)
    if not address:
        raise OSError(f"EGL has no {name.decode()}")
    return ctypes.CFUNCTYPE(*types)(address)


def _cuda_device(egl: ctypes.CDLL, device: int) -> int | None:
    value, result = ctypes.c_ssize_t(-1), ctypes.POINTER(ctypes.c_ssize_t)
    ask = _function(egl, b"eglQueryDeviceAttribEXT", ctypes.c_uint, ctypes.c_void_p, ctypes.c_int, result)
    return value.value if ask(device, _CUDA_DEVICE, ctypes.byref(value)) else None


def _opens(egl: ctypes.CDLL, device: int) -> bool:
    show = _function(egl, b"eglGetPlatformDisplayEXT", ctypes.c_void_p, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)
    display = show(_PLATFORM_DEVICE, device, None)
    egl.eglInitialize.argtypes = [ctypes.c_void_p] * 3
    return bool(display and egl.eglInitialize(display, None, None))


if __name__ == "__main__":
    main()
