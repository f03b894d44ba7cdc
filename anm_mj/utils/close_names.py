"""What somebody may have meant by a name that does not exist."""

import difflib
from collections.abc import Iterable


def close_name(name: str, known: Iterable[str]) -> str:
    """`` (did you mean X?)`` where a known name is close, else nothing; stands behind the name in a sentence."""
    close = difflib.get_close_matches(name.lower(), sorted(known), n=1)
    return f" (did you mean {close[0]}?)" if close else ""
