"""The page of a comparison, one HTML file with its tables and pictures, and its data card.

The page fetches nothing.
"""

import base64
import html
from collections.abc import Mapping, Sequence
from pathlib import Path

from markdown_it import MarkdownIt

from anm_mj.bench.job import variant
from anm_mj.bench.markdown_table import Rows, split_by
from anm_mj.utils.files import write_text
from anm_mj.utils.markdown import table

PAGE, CARD = "report.html", "data_card.md"
_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 75rem; margin: 2rem auto; padding: 0 1rem; color: #1f1f1f; }
table { border-collapse: collapse; font-size: 13px; display: block; overflow-x: auto; }
th, td { padding: .2rem .6rem; border-bottom: 1px solid #ddd; white-space: nowrap; }
th { background: #f3f3f3; text-align: left; white-space: normal; min-width: 4.5rem; }
td:first-child { position: sticky; left: 0; background: #fff; }
tr:hover td { background: #f6f9fc; }
p { overflow-x: auto; }
img { max-width: 100%; height: auto; }
@media (max-width: 44rem) { p img { max-width: none; width: 36rem; } }
h2 { margin-top: 2.5rem; border-top: 1px solid #ddd; padding-top: 1rem; }
"""

_CARD = """\
# Data card: {title}

Made by `{command}`. Each row of `results.csv` is one run of one policy from one start at one budget.

{scenes}

**Policies:** {variants}.

**Revision of the program:** {revisions}; `+` marks a checkout with changes.

**Measured:** completion by 200,000 samples of the true surface, frames reduced to 128 x 128 pixels, 5 cm; the \
observable part alone where a column says so. Areas under the curve are means over the budget.

**Counted:** turns and collisions are steps. A run that never reaches a level counts with its budget. Starts and \
seeds of one scene are averaged before scenes are compared; intervals are of a bootstrap over scenes.

**Limits:** simulated scenes; one robot unless a row says otherwise; what holds for these scenes need not hold for \
others. Columns that begin with `hz`, and `wall_s`, `evaluation_s` and `peak_rss_mib`, depend on the machine and what \
else it did; all others repeat byte for byte on the same type of machine.
"""


def write_page(out: Path, title: str, tables: str, card: str, pictures: Mapping[str, Sequence[Path]]) -> None:
    """Write ``report.html`` in the folder of a comparison, from its tables and its data card in Markdown. ``pictures``
    are PNG files by the heading that they stand under; those of the empty heading come first. Raises OSError if the
    file cannot be written, or a picture cannot be read.
    """
    render = MarkdownIt("commonmark", {"html": False}).enable("table").render
    introduction, *sections = tables.split("\n## ")
    parts = [f"<h1>{html.escape(title)}</h1>", render(introduction), *map(_image, pictures.get("", ()))]
    for section in sections:
        heading, _, body = section.partition("\n")
        parts += [f"<h2>{html.escape(heading)}</h2>", *map(_image, pictures.get(heading, ())), render(body)]
    parts.append(render(f"#{card}"))  # Its title is a heading of this page.
    text = (
        f'<!doctype html>\n<html lang="en">\n<meta charset="utf-8">\n<title>{html.escape(title)}</title>\n'
        f"<style>{_STYLE}</style>\n" + "\n".join(parts) + "\n</html>\n"
    )
    write_text(out / PAGE, text)


def _image(path: Path) -> str:
    data = base64.b64encode(path.read_bytes()).decode("ascii")
    return f'<p><img alt="{html.escape(path.stem)}" src="data:image/png;base64,{data}"></p>'


def data_card(rows: Rows, title: str, command: str) -> str:
    """What the numbers of a comparison are: scenes with hashes, variants, budgets, protocol and limits, in Markdown.
    ``rows`` are those of the results table.
    """
    lines = []
    for name, here in split_by(rows, "scene").items():
        budgets = sorted({(row["budget"], row["budget_by"]) for row in here})
        text = ", ".join(f"{steps} (by {by})" if by else str(steps) for steps, by in budgets)
        lines.append([name, f"`{here[-1]['scene_hash'][:12]}`", str(len(split_by(here, "start"))), text])
    scenes = table(("scene", "hash", "starts, at most", "budgets [steps]"), lines, text_columns=(0, 1, 3))
    variants = ", ".join(f"`{name}`" for name in dict.fromkeys(map(variant, rows)))
    revisions = ", ".join(f"`{name}`" for name in sorted(split_by(rows, "revision")))
    return _CARD.format(title=title, command=command, scenes=scenes, variants=variants, revisions=revisions)
