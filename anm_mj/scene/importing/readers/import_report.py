"""What could not be taken over from a source, gathered while it is read and said once at its end."""

from __future__ import annotations

import logging

_logger = logging.getLogger(__name__)

_NAMED = 8
"""So many names are spelt out; of the others only the number is said."""


class ImportReport:
    """Things that are missing or left out, by what that means for the scene."""

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
        """One sentence for each kind of trouble, with the names of all that it befell."""
        spoken = []
        for sentence, names in self._names.items():
            first = ", ".join(list(names)[:_NAMED])
            rest = len(names) - _NAMED
            spoken.append(sentence.replace("{names}", first if rest <= 0 else f"{first} and {rest} more"))
        return spoken

    def log(self) -> None:
        """Warn of everything noted."""
        for sentence in self.sentences():
            _logger.warning("%s", sentence)
