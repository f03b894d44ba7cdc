"""Collects what cannot be imported from a source, and logs it once at the end."""

import logging
from collections.abc import Collection
from dataclasses import dataclass, field

_logger = logging.getLogger(__name__)

LEFT_OUT = "Left out, because they cannot be read: {names}."
NO_MESH = "Not found: the meshes {names}, which are left out."
NO_SHAPE = "Left out, because such shapes cannot be imported: {names}."


@dataclass
class ImportReport:
    """Missing and skipped things, by what that means for the scene."""

    _names: dict[str, dict[str, None]] = field(default_factory=dict)

    def add(self, sentence: str, name: str) -> None:
        """Note a thing once; the sentence says what comes of it, with ``{names}`` for the names of all such things."""
        self._names.setdefault(sentence, {})[name] = None

    def sentences(self) -> list[str]:
        """One sentence per problem, with the names of all that it concerns."""
        return [sentence.replace("{names}", some(names, 8)) for sentence, names in self._names.items()]

    def log(self) -> None:
        """Log every sentence as a warning."""
        for sentence in self.sentences():
            _logger.warning("%s", sentence)


def some(names: Collection[str], number: int = 12) -> str:
    """The first names of many, and how many more there are."""
    first = ", ".join(list(names)[:number])
    return first if len(names) <= number else f"{first} and {len(names) - number} more"
