"""Puts the tables and pictures of a finished comparison onto its page of the documentation.

    python scripts/publish_benchmark.py bench/test

writes docs/benchmarks/test.md and the pictures beside it, in docs/benchmarks/test/, with few colours so that they stay
small. Of a page that is there only what stands between its marks is replaced.
"""

import re
from pathlib import Path
from typing import Annotated

import tyro
from PIL import Image

from anm_mj.errors import AnmError

PAGES = Path(__file__).resolve().parents[1] / "docs" / "benchmarks"
BEGIN, END = "<!-- results -->", "<!-- /results -->"
COLOURS = 256
PICTURES = {
    r"## Mean over .*, budget by (\w+)": (("overview_{}", "Mean coverage over scenes, and performance profiles"),),
    r"## Mean over [^,]*": (("overview", "Mean coverage over scenes, and performance profiles"),),
    r"## (\S+)": (("curves_{}", "Coverage against steps"), ("scene_{}", "Run of median AUC of each policy")),
}
"""Pictures below each kind of heading of the tables, and what they show."""


def main(comparison: Annotated[Path, tyro.conf.Positional], pages: Path = PAGES) -> None:
    """Publish a comparison.

    Args:
        comparison: Folder that ``anm-mj bench`` has written.
        pages: Folder of the page, which is named like the comparison.
    """
    name = comparison.resolve().name
    page, pictures = pages / f"{name}.md", pages / name
    try:
        table = (comparison / "table.md").read_text(encoding="utf-8")
        text = page.read_text(encoding="utf-8") if page.exists() else f"# Suite {name}\n\n{BEGIN}\n{END}\n"
    except OSError as err:
        raise AnmError(f"{err.filename} cannot be read ({err.strerror}); give a folder of anm-mj bench.") from err
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise AnmError(f"{page} holds no marks {BEGIN} and {END}; put them where the results belong.")
    pictures.mkdir(parents=True, exist_ok=True)
    for former in pictures.glob("*.png"):
        former.unlink()
    lines = []
    for line in table.splitlines():
        lines.append(line)
        for picture, shows in _pictures_below(line, comparison):
            if (pictures / picture.name).exists():
                continue
            with Image.open(picture) as drawn:
                drawn.convert("RGB").quantize(COLOURS).save(pictures / picture.name, optimize=True)
            lines += ["", f"![{shows}]({name}/{picture.name})"]
    page.write_text(f"{before}{BEGIN}\n" + "\n".join(lines) + f"\n{END}{after}", encoding="utf-8")


def _pictures_below(line: str, comparison: Path) -> list[tuple[Path, str]]:
    """The pictures that belong below a line of the tables, and what they show."""
    for pattern, named in PICTURES.items():
        found = re.fullmatch(pattern, line)
        if found is not None:
            paths = [(comparison / f"{stem.format(*found.groups())}.png", shows) for stem, shows in named]
            return [(path, shows) for path, shows in paths if path.is_file()]
    return []


if __name__ == "__main__":
    tyro.cli(main)
