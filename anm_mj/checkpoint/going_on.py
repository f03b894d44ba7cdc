"""How a run is put back to where its checkpoint was taken."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, TypeVar

from msgspec import Meta, Struct

from anm_mj.checkpoint.checkpoint_file import StoredState
from anm_mj.checkpoint.decode import restore
from anm_mj.checkpoint.known_classes import KnownClasses
from anm_mj.checkpoint.store import CheckpointStore
from anm_mj.errors import AnmError, CheckpointError
from anm_mj.planning.policies.guarded_policy import describe_error
from anm_mj.utils.read_file import convert

_logger = logging.getLogger(__name__)


class LoggedFacts(Struct):
    """What a run says of itself in a checkpoint."""

    files: dict[str, Annotated[int, Meta(ge=0, le=1 << 50)]]
    """Lengths of its logs by name [bytes]."""
    engine: str
    wall_s: Annotated[float, Meta(ge=0.0, le=1e12)]


Kind = TypeVar("Kind", bound=LoggedFacts)


def logged_facts(stored: StoredState, kind: type[Kind], folder: Path, unit: str) -> Kind:
    """The facts of a checkpoint whose logs reach as far as it does; ``unit`` is what its number counts. Raises
    CheckpointError if they are others, or a log is shorter.
    """
    try:
        facts = convert(stored.facts, kind)
    except ValueError as err:
        raise CheckpointError(f"It does not say what it was made of ({err}).") from err
    for name, size in facts.files.items():
        path = folder / Path(name).name
        if not path.is_file() or path.stat().st_size < size:
            raise CheckpointError(f"{path.name} is shorter than it was at {unit} {stored.step}.")
    return facts


@contextmanager
def of_stored_state(stored: StoredState, store: CheckpointStore | None = None) -> Iterator[None]:
    """Turns whatever a stored state leads to into a CheckpointError: anybody may have written it. Once ``store`` has a
    later checkpoint, an error is one of the program, from which the run goes on.
    """
    try:
        yield
    except (AnmError, MemoryError):
        raise
    except Exception as err:
        if store is not None and store.has_after(stored.step):
            raise
        _logger.debug("The error of the resumed run:", exc_info=True)
        raise CheckpointError(
            f"The run cannot go on from its checkpoint at step {stored.step} ({describe_error(err)}); start it again."
        ) from err


def lay_over(stored: StoredState, roots: dict[str, Any], known: KnownClasses) -> None:
    """Fill newly made objects with the stored state; raises CheckpointError where it is that of another run."""
    with of_stored_state(stored):
        try:
            restore(stored.nodes, stored.arrays, roots, known)
        except CheckpointError as err:
            raise CheckpointError(f"The checkpoint at step {stored.step} does not fit this run: {err}") from err


def say_other_engine(stored: StoredState, engine: str) -> None:
    """Warn where the map was trained by another engine than the one that goes on."""
    if stored.facts.get("engine") != engine:
        _logger.warning(
            "The map was trained by %s and now is by %s: the run goes on, but not byte for byte.",
            stored.facts.get("engine"),
            engine,
        )


def first_difference(before: dict[str, Any], now: dict[str, Any], free: tuple[str, ...]) -> str | None:
    """The first setting, by its name, that two configurations say differently; one with a free beginning may."""
    both = sorted(before.keys() & now.keys())
    return next((name for name in both if name.split(".")[0] not in free and before[name] != now[name]), None)
