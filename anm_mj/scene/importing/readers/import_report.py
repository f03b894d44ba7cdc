"""Collects what cannot be imported from a source, and logs it once at the end."""

from __future__ import annotations

import logging

_logger = logging.getLogger(__name__)

_NAMED = 8
"""Number of names that are written out; the others are counted."""

LEFT_OUT = "Left out, because they cannot be read: {names}."


class ImportReport:
    """Missing and skipped things, by what that means for the scene."""

    def __init__(self) -> None:
        self._names: dict[str, dict[str, None]] = {}

    def add(self, sentence: str, name: str) -> None:
        """Note a thing once.

        Args:
            sentence: What is wrong and what comes of it, with ``{names}`` where the names of all such things belong.
            name: The thing.
        """
        self._names.setdefault(sentence, {})[name] = None

    def sentences(self) -> list[str]:
        """One sentence per problem, with the names of all that it concerns."""
        spoken = []
        for sentence, names in self._names.items():
            first = ", ".join(list(names)[:_NAMED])
            rest = len(names) - _NAMED
            spoken.append(sentence.replace("{names}", first if rest <= 0 else f"{first} and {rest} more"))
        return spoken

    def log(self) -> None:
        """Log every sentence as a warning."""
        for sentence in self.sentences():
            _logger.warning("%s", sentence)
