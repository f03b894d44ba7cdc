"""The checkpoints of one run: the two newest, because a crash of the machine can damage the last one."""

import contextlib
import errno
import logging
import math
import shutil
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from anm_mj.checkpoint.checkpoint_config import CheckpointConfig
from anm_mj.checkpoint.checkpoint_file import StoredState, complete_draft, read_checkpoint, write_draft
from anm_mj.checkpoint.encode import Graph, encode
from anm_mj.checkpoint.known_classes import KnownClasses
from anm_mj.errors import CheckpointError, RunFolderError
from anm_mj.utils.files import beside, sync
from anm_mj.utils.read_file import read_text

_logger = logging.getLogger(__name__)

NUM_KEPT = 2
"""Checkpoints of a run that are kept."""
SPARE_BYTES = 16 << 20
"""A checkpoint leaves this much of the disk to the logs, which the run cannot do without [bytes]."""
_PATTERN = "*.checkpoint"
_REFUSED = "refused.txt"


class CheckpointStore:
    """The folder of a run's checkpoints."""

    def __init__(self, folder: Path) -> None:
        """Name the folder; it is made with the first checkpoint."""
        self.folder = folder

    def draft(self, step: int, facts: dict[str, Any], graph: Graph) -> Path:
        """Write the content of a checkpoint, which may change afterwards; :meth:`complete` makes it one. Raises OSError
        if it cannot be written.
        """
        self.folder.mkdir(exist_ok=True)
        needed = graph.num_bytes + SPARE_BYTES
        if shutil.disk_usage(self.folder).free < needed:
            raise OSError(errno.ENOSPC, f"it needs {needed >> 20} MiB, more than the disk has free")
        draft = beside(self._path(step))
        write_draft(draft, step, facts, graph)
        return draft

    def complete(self, step: int, draft: Path) -> int:
        """Make a draft a checkpoint, remove all but the newest two; its size [bytes]. Raises OSError if it fails."""
        size = complete_draft(draft, self._path(step))
        for path in self._newest_first()[NUM_KEPT:]:
            path.unlink(missing_ok=True)
        return size

    @property
    def is_empty(self) -> bool:
        """Whether no checkpoint was written yet."""
        return not self._newest_first()

    def newest(self, accept: Callable[[StoredState], object] = lambda state: None) -> StoredState:
        """The newest checkpoint that is whole; it is logged where that is not the last one written. ``accept`` raises
        CheckpointError where a whole one does not fit the rest of the run's folder. Raises CheckpointError if there is
        none.
        """
        paths = self._newest_first()
        for number, path in enumerate(paths):
            try:
                state = read_checkpoint(path)
                accept(state)
            except CheckpointError as err:
                rest = "the one before is used" if number + 1 < len(paths) else "there is none before"
                _logger.warning("Checkpoint %s is left out: %s Instead, %s.", path.name, err, rest)
            else:
                return state
        refused = self.folder / _REFUSED
        if refused.is_file():
            raise CheckpointError(f"The run in {self.folder.parent} cannot be resumed: {read_text(refused)[:500]}")
        raise CheckpointError(
            f"{self.folder.parent} has no {'whole ' if paths else ''}checkpoint to resume from; start the run again."
        )

    def has_after(self, step: int) -> bool:
        """Whether there is a checkpoint that was taken after a step."""
        return bool(self._after(step))

    def drop_after(self, step: int) -> None:
        """Remove checkpoints that were left out for the one at a step, whose logs are cut. Raises RunFolderError if one
        cannot be removed.
        """
        with _changing(self.folder):
            for path in self._after(step):
                path.unlink(missing_ok=True)

    def refuse(self, why: str) -> None:
        """Note why the state of the run cannot be stored, for the error of a later resume. Raises RunFolderError if it
        cannot be written.
        """
        with _changing(self.folder):
            self.folder.mkdir(exist_ok=True)
            (self.folder / _REFUSED).write_text(why, encoding="utf-8")

    def remove(self) -> None:
        """Remove all checkpoints of a finished run. Raises RunFolderError if one cannot be removed."""
        with _changing(self.folder):
            for path in [*self.folder.glob(_PATTERN), *self.folder.glob(f".{_PATTERN}.*"), self.folder / _REFUSED]:
                path.unlink(missing_ok=True)
        with contextlib.suppress(OSError):
            self.folder.rmdir()

    def _path(self, step: int) -> Path:
        return self.folder / f"{step:06d}.checkpoint"

    def _after(self, step: int) -> list[Path]:
        own = self._path(step)
        return [path for path in self._newest_first() if _by_number(path) > _by_number(own)]

    def _newest_first(self) -> list[Path]:
        there = (path for path in self.folder.glob(_PATTERN) if path.is_file())
        return sorted(there, key=_by_number, reverse=True)


@contextlib.contextmanager
def _changing(folder: Path) -> Iterator[None]:
    """Turns errors of the system into a RunFolderError that names the folder."""
    try:
        yield
    except OSError as err:
        raise RunFolderError(f"{folder} cannot be changed ({err.strerror or err}); make it writable.") from err


def _by_number(path: Path) -> tuple[int, str]:
    """Orders checkpoints by their steps: names of a million and more are longer."""
    return len(path.stem), path.stem


class Checkpointer:
    """Takes checkpoints while a run goes on; the loop waits for the system to take the state, not for the disk.

    Memory holds no copy of the state. Another thread hashes it and forces it to the disk, one checkpoint at a time.
    """

    def __init__(
        self,
        store: CheckpointStore,
        config: CheckpointConfig,
        roots: Callable[[], dict[str, Any]],
        facts: Callable[[], tuple[dict[str, Any], Iterable[Path]]],
        known: KnownClasses,
        *,
        resumed_at: int | None = None,
    ) -> None:
        """Start before the first checkpoint. ``roots`` gives the objects to store, ``facts`` what else to store, and
        the files that must be on the disk before the checkpoint counts; classes of ``known`` may take part.
        ``resumed_at`` is the step of the checkpoint that the run resumed from.
        """
        self._store, self._config, self._roots, self._facts, self._known = store, config, roots, facts, known
        self.last_step = resumed_at
        """Step of the last checkpoint; None before the first."""
        self.synced_step = -1 if resumed_at is None else resumed_at
        """Up to here, what must be on the disk is there; -1 before the first."""
        self._enabled = config.every_steps > 0
        self._thread: threading.Thread | None = None
        self._failed: OSError | None = None
        """Why not even a first checkpoint was written."""
        self._spent_before_s = 0.0
        self.spent_s = 0.0
        """Time spent so far, also that of the writing thread's processor [s]."""
        self.num_bytes = 0
        """Size of the last checkpoint [bytes]."""

    def after_step(self, step: int, loop_s: float) -> None:
        """Take a checkpoint where one is due. So far there were ``step`` actions, and the loop took ``loop_s`` [s].
        Raises RunFolderError if not even a first one could be written: the run would lose all at its end.
        """
        self._require_first()
        if not self._enabled or step == self.last_step:
            return
        since = math.inf if self.last_step is None else step - self.last_step
        is_writing = self._thread is not None and self._thread.is_alive()
        if since >= self._config.every_steps and not is_writing and self._is_affordable(loop_s):
            self._take(step)
            # What the loop knows by now is said before the robot drives; what the thread meets, later.
            if self._thread is None:
                self._require_first()

    def _require_first(self) -> None:
        if self._failed is not None:
            raise RunFolderError(
                f"No checkpoint can be written in {self._store.folder.parent} "
                f"({self._failed.strerror or self._failed}); free some space, choose another folder, or do without by "
                "--set checkpoint.every_steps=0."
            )

    def finish(self, step: int, *, resumable: bool) -> None:
        """End: with a last checkpoint where the run may be resumed, else with all of them removed."""
        self.close()
        if self._failed is not None:
            self._warn(0, self._failed)
        if resumable:
            if self._enabled and step != self.last_step:
                self._take(step)
                self.close()
        else:
            self._store.remove()

    def _is_affordable(self, loop_s: float) -> bool:
        """Whether one more, at twice the last one's price as the map grows, stays within its share of the time."""
        next_s = 2.0 * (self.spent_s - self._spent_before_s)
        if self.last_step is None or self._config.loop_share == 1.0:
            return True
        return self.spent_s + next_s <= self._config.loop_share * loop_s

    def close(self) -> None:
        """Wait until the last checkpoint is written."""
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def _take(self, step: int) -> None:
        begin, self._spent_before_s = time.perf_counter(), self.spent_s
        try:
            graph = encode(self._roots(), self._known)
        except CheckpointError as err:
            self._enabled = False
            _logger.warning("This run cannot be resumed once it has ended: %s", err)
            self._store.refuse(str(err))
            return
        facts, files = self._facts()
        self.last_step = step
        self.close()
        try:
            draft = self._store.draft(step, facts, graph)
        except OSError as err:
            self._lose(step, err)
        else:
            self._thread = threading.Thread(
                target=self._complete, args=(step, draft, list(files)), name="checkpoint", daemon=True
            )
            self._thread.start()
        self.spent_s += time.perf_counter() - begin

    def _complete(self, step: int, draft: Path, files: list[Path]) -> None:
        begin = time.thread_time()
        try:
            for path in files:
                sync(path)
            self.num_bytes = self._store.complete(step, draft)
            self.synced_step = step
        except OSError as err:
            self._lose(step, err)
        self.spent_s += time.thread_time() - begin

    def _lose(self, step: int, err: OSError) -> None:
        """Go on without this checkpoint, if there is one before it."""
        if self._store.is_empty:
            self._failed = err
        else:
            self._warn(step, err)

    def _warn(self, step: int, err: OSError) -> None:
        _logger.warning(
            "No checkpoint was written at step %d (%s); free some space below %s.",
            step,
            err.strerror or err,
            self._store.folder.parent,
        )
