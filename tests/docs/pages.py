"""Reads the documentation: its commands, its settings, its options, and the files that it names."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "models").rglob("*.md")),
]

COMMAND = re.compile(r"(anm-mj|python|make|pytest|pip|apt|source|export) \S")
SETTING = re.compile(r"(?<![\w.])([a-z]\w*(?:\.[a-z]\w*)+|image_px)=((?:\([\w+,./-]*\)|[\w+,./-])+)")
OPTION = re.compile(r"(?<![\w-])--[a-z][a-z0-9-]*")
LINK = re.compile(r"\]\(([^)\s]+)\)")
FILE = re.compile(r"(?<![\w/.-])((?:anm_mj|docs|models|native|scenes|scripts|tests)/[\w./-]*\w/?)")


@dataclass(frozen=True)
class Block:
    """An indented or fenced block of code."""

    language: str
    """As the fence says; ``console`` for indented blocks and fences without a language."""
    text: str


def blocks(text: str) -> list[Block]:
    """The blocks of code of a page."""
    return [block for block, _ in _parts(text) if block is not None]


def prose(text: str) -> str:
    """A page without its blocks of code."""
    return "\n".join(line for block, line in _parts(text) if block is None)


def inline_code(text: str) -> list[str]:
    """The spans of code in the prose of a page, each in one line."""
    return [" ".join(span.split()) for span in re.findall(r"`([^`]+)`", prose(text))]


def commands() -> Iterator[tuple[str, str]]:
    """Name of the page and command, for every command that the documentation prints."""
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for block in blocks(text):
            if block.language == "console":
                for line in block.text.splitlines():
                    if command := re.sub(r"(^|\s)#.*", "", line).strip():
                        yield str(page.relative_to(ROOT)), command
        for span in inline_code(text):
            if COMMAND.match(span):
                yield str(page.relative_to(ROOT)), span


def settings() -> set[str]:
    """Every ``group.name=value`` that the documentation prints."""
    found = set()
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for code in [*inline_code(text), *(block.text for block in blocks(text) if block.language != "python")]:
            found |= {f"{name}={value.rstrip('.,')}" for name, value in SETTING.findall(code)}
    return found


def options() -> set[str]:
    """Every ``--option`` that the documentation prints."""
    texts = (page.read_text(encoding="utf-8") for page in PAGES)
    codes = (code for text in texts for code in (*inline_code(text), *(block.text for block in blocks(text))))
    return {option for code in codes for option in OPTION.findall(code)}


def files() -> set[tuple[str, str]]:
    """Name of the page and path from the root, for every file of the project that the documentation names."""
    found = set()
    for page in PAGES:
        name, text = str(page.relative_to(ROOT)), page.read_text(encoding="utf-8")
        for path in (path for code in inline_code(text) for path in FILE.findall(code)):
            found.add((name, path))
        for link in LINK.findall(prose(text)):
            if "://" not in link:
                found.add((name, str((page.parent / link.partition("#")[0]).resolve().relative_to(ROOT))))
    return found


def _parts(text: str) -> Iterator[tuple[Block | None, str]]:
    """A page as lines of prose and blocks of code."""
    fence: list[str] | None = None
    language = ""
    indented: list[str] = []
    before = ""
    for line in [*text.splitlines(), ""]:
        if fence is not None:
            if line.startswith("```"):
                yield Block(language, "\n".join(fence)), ""
                fence = None
            else:
                fence.append(line)
        elif line.startswith("```"):
            fence, language = [], (line[3:].split() or ["console"])[0]
        elif line.startswith("    ") and (indented or not before.strip()):
            indented.append(line[4:])
        else:
            if indented:
                yield Block("console", "\n".join(indented)), ""
                indented = []
            yield None, line
        before = line
