"""Stands in for CUDA graphs where there is no GPU: what is captured is noted, and done again by each replay.

As in a CUDA graph, capturing runs nothing that writes into an array from before, replaying runs nothing of the Python
code that was captured, and every operation uses the very arrays, and the very numbers, of its capture.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import torch
from torch.utils._python_dispatch import TorchDispatchMode, _disable_current_modes
from torch.utils._pytree import tree_leaves

_recording: list["RecordedGraph"] = []


class RecordedGraph:
    """Takes the place of ``torch.cuda.CUDAGraph``."""

    def __init__(self) -> None:
        self.calls: list[Callable[[], None]] = []
        self.names: list[str] = []
        self.num_replays = 0

    def note(self, name: str, call: Callable[[], None]) -> None:
        self.names.append(name)
        self.calls.append(call)

    def replay(self) -> None:
        self.num_replays += 1
        for call in self.calls:
            call()


@contextmanager
def record(graph: RecordedGraph) -> Iterator[None]:
    """Takes the place of ``torch.cuda.graph``."""
    _recording.append(graph)
    try:
        with _Operations(graph):
            yield
    finally:
        _recording.pop()


class RecordedKernel:
    """Takes the place of a Triton kernel."""

    def __init__(self, kernel) -> None:
        self._kernel = kernel

    def __getitem__(self, grid):
        def launch(*args, **kwargs):
            def call():
                with _disable_current_modes():
                    self._kernel[grid](*args, **kwargs)

            if _recording:
                _recording[-1].note("kernel", call)
            else:
                call()

        return launch


class _Operations(TorchDispatchMode):
    """Notes torch's operations; of those that write, only that."""

    def __init__(self, graph: RecordedGraph) -> None:
        super().__init__()
        self._graph = graph

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        kwargs = kwargs or {}
        values = dict(zip((a.name for a in func._schema.arguments), args, strict=False)) | kwargs
        written = [values[a.name] for a in func._schema.arguments if a.alias_info and a.alias_info.is_write]
        if written:
            self._graph.note(str(func), lambda: func(*args, **kwargs))
            return written[0]
        out = func(*args, **kwargs)

        def call():
            for old, new in zip(tree_leaves(out), tree_leaves(func(*args, **kwargs)), strict=True):
                if isinstance(old, torch.Tensor) and old.data_ptr() != new.data_ptr():
                    old.copy_(new)

        self._graph.note(str(func), call)
        return out
