"""Limits of what files of others may ask for; each is an environment variable that raises it."""

import os


def limit(name: str, default: int) -> int:
    """A limit: the whole number in an environment variable, else the default."""
    text = os.environ.get(name, "")
    return int(text) if text.isdecimal() else default


MAX_CELLS = limit("ANM_MJ_MAX_CELLS", 25_000_000)
"""Most cells of what a file makes in the plane: textures and height fields of an MJCF file, the map of a decision."""
MAX_TEXTURE_MEGAPIXELS = limit("ANM_MJ_MAX_TEXTURE_MEGAPIXELS", 500)
"""Most megapixels in the textures of one mesh file, or of an MJCF file."""
