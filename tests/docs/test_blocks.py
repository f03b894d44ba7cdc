"""Executes every block of Python that README and docs print, page by page, in a small scene and for a few steps."""

import re

import pytest

import anm_mj
from tests.docs.pages import PAGES, ROOT, blocks

SMALLER = (
    (r'"home"', '"room"'),
    (r"\b500\b", "6"),
    (r"num_envs=8", "num_envs=1"),
    (r"image_px=128", "image_px=32"),
    (r'scene="room"\)?', lambda found: found[0].replace('"room"', '"room", image_px=32')),
    (
        r"settings=\[",
        'settings=["image_px=32", "mapping.schedule.first_iterations=5", "mapping.schedule.final_iterations=0", ',
    ),
)
"""What makes a block quick: patterns and what stands in their place."""
WITH_PYTHON = [page for page in PAGES if any(block.language == "python" for block in blocks(page.read_text("utf-8")))]


def smaller(text):
    for pattern, replacement in SMALLER:
        text = re.sub(pattern, replacement, text)
    return text


LONG = ("compare", "library", "map", "scene", "start")
"""Pages that take more than ten seconds; the numbered scripts do much of what they do."""


@pytest.mark.parametrize(
    "page",
    [pytest.param(page, marks=[pytest.mark.slow] if page.stem in LONG else [], id=page.stem) for page in WITH_PYTHON],
)
def test_python(page, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "templates"))
    names = {"__name__": "__main__"}
    for block in blocks(page.read_text(encoding="utf-8")):
        if block.language == "python":
            exec(compile(smaller(block.text), f"{page.name}", "exec"), names)


def test_there_are_blocks_to_execute():
    assert {page.stem for page in WITH_PYTHON} >= {
        "compare",
        "environments",
        "learn",
        "library",
        "map",
        "policy",
        "robot",
        "scenes",
    }


def test_public_names():
    assert {name for name in anm_mj.__all__ if getattr(anm_mj, name, None) is None} == set()
    assert set(anm_mj.__all__) <= set(dir(anm_mj))
    with pytest.raises(AttributeError, match="no attribute 'explorer'"):
        getattr(anm_mj, "explorer")  # noqa: B009
