"""Changes what a .glb says about itself."""

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any


def patch_glb(path: Path, change: Callable[[dict[str, Any]], None]) -> Path:
    """Rewrite the JSON of a .glb by a function that changes it in place."""
    whole = path.read_bytes()
    length = struct.unpack_from("<I", whole, 12)[0]
    header, body = json.loads(whole[20 : 20 + length]), whole[20 + length :]
    change(header)
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    start = struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text) + len(body), len(text), b"JSON")
    path.write_bytes(start + text + body)
    return path
