"""Lines of the package by floor and room, and its largest files; the floors are those of tests/test_import_arrows.py.

python scripts/count_lines.py
"""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path

_ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(_ROOT))
from tests.test_import_arrows import FLOORS, room_of  # noqa: E402


def main() -> None:
    """Count and print."""
    lines = {path: len(path.read_text().splitlines()) for path in sorted((_ROOT / "anm_mj").rglob("*.py"))}
    rooms: Counter[str] = Counter()
    for path, count in lines.items():
        rooms[room_of(path)] += count
    for floor, tiers in FLOORS.items():
        names = [room for tier in tiers for room in tier]
        parts = ", ".join(f"{room} {rooms[room]}" for room in names if rooms[room])
        print(f"{floor}: {sum(rooms[room] for room in names)} ({parts})")
    print(f"all: {sum(lines.values())}")
    for path in sorted(lines, key=lambda path: -lines[path])[:3]:
        print(f"{lines[path]} {path.relative_to(_ROOT)}")


if __name__ == "__main__":
    main()
