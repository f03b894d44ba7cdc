"""Puts the tables and pictures of a finished comparison into docs/benchmarks.md.

    python scripts/publish_benchmark.py bench/benchmark

Replaces what stands between the marks of the page's section *Results*, and the pictures beside it, which get few
colours so that they stay small.
"""

import re
from pathlib import Path
from typing import Annotated

import tyro
from PIL import Image

from anm_mj.errors import AnmError

PAGE = Path(__file__).resolve().parents[1] / "docs" / "benchmarks.md"
BEGIN, END = "<!-- results -->", "<!-- /results -->"
COLOURS = 256


def main(comparison: Annotated[Path, tyro.conf.Positional], page: Path = PAGE) -> None:
    """Publish a comparison.

    Args:
        comparison: Folder that ``anm-mj bench`` has written.
        page: The page; pictures go to a folder beside it that is named like it.
    """
    try:
        table = (comparison / "table.md").read_text(encoding="utf-8")
        text = page.read_text(encoding="utf-8")
    except OSError as err:
        raise AnmError(f"{err.filename} cannot be read ({err.strerror}); give a folder of anm-mj bench.") from err
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise AnmError(f"{page} holds no marks {BEGIN} and {END}; put them where the results belong.")
    pictures = page.with_suffix("")
    pictures.mkdir(exist_ok=True)
    lines = []
    for line in table.splitlines():
        # Headings stand one deeper than in the table's own file.
        lines.append(re.sub("^##", "###", line))
        picture = comparison / f"curves_{line.removeprefix('## ')}.png"
        if line.startswith("## ") and picture.is_file():
            with Image.open(picture) as drawn:
                drawn.convert("RGB").quantize(COLOURS).save(pictures / picture.name, optimize=True)
            lines += ["", f"![Coverage against steps]({pictures.name}/{picture.name})"]
    page.write_text(f"{before}{BEGIN}\n" + "\n".join(lines) + f"\n{END}{after}", encoding="utf-8")


if __name__ == "__main__":
    tyro.cli(main)
