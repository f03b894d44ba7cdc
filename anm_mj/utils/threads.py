"""How many threads numerical work gets, and tasks that a thread of its own does in order."""

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from queue import Queue

from anm_mj import _native

_MOST_THREADS = 256
"""More find no work; each takes a megabyte of the engine's."""


def usual_num_threads() -> int:
    """As ``OMP_NUM_THREADS`` says, like OpenMP and torch, but 256 at most; without it, one per core that the process
    may use.
    """
    try:
        asked = int(os.environ.get("OMP_NUM_THREADS", "").partition(",")[0])
    except ValueError:
        asked = 0
    if asked > 0:
        return min(asked, _MOST_THREADS)
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # Not on macOS.
        return os.cpu_count() or 1


_lock = threading.Lock()
_lent = 0


@contextmanager
def lent_core() -> Iterator[None]:
    """While this goes on, another thread computes on one of the cores; the native engine does with one less."""
    _change(1)
    try:
        yield
    finally:
        _change(-1)


def _change(by: int) -> None:
    global _lent
    with _lock:
        _lent += by
        _native.lend_cores(_lent)


class Background:
    """Does tasks one after another in a thread of its own, with a core of its own.

    At most ``room`` tasks wait: who gives another one waits as well. After a task that failed none is done any more.
    """

    def __init__(self, name: str, room: int) -> None:
        self._name = name
        self._tasks: Queue[Callable[[], object] | None] = Queue(room)
        self._thread: threading.Thread | None = None
        self._error: BaseException | None = None

    def submit(self, task: Callable[[], object]) -> None:
        """Have a task done after all others. Raises BaseException: what an earlier task raised."""
        self._raise()
        if self._thread is None:
            self._thread = threading.Thread(target=self._work, name=self._name, daemon=True)
            self._thread.start()
        self._tasks.put(task)

    def flush(self) -> None:
        """Wait until all tasks are done. Raises BaseException: what a task raised."""
        self._tasks.join()
        self._raise()

    def close(self) -> None:
        """Wait until all tasks are done, and end the thread; errors stay untold. A second time does nothing."""
        if self._thread is not None:
            self._tasks.put(None)
            self._thread.join()
            self._thread = None

    def _raise(self) -> None:
        if self._error is not None:
            raise self._error

    def _work(self) -> None:
        while (task := self._tasks.get()) is not None:
            if self._error is None:
                try:
                    with lent_core():
                        task()
                except BaseException as err:
                    self._error = err
            self._tasks.task_done()
        self._tasks.task_done()
