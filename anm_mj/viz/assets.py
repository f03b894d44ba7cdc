"""The files that pages are made of: our own, and meshcat's bundle of three.js."""

import json
from importlib import resources
from pathlib import Path

import meshcat


def page_asset(*names: str) -> str:
    """The text of files of ``anm_mj/viz/pages``; scripts come after those that they stand on."""
    pages = resources.files("anm_mj.viz").joinpath("pages")
    return "\n".join(pages.joinpath(name).read_text(encoding="utf-8") for name in names)


def filled(name: str, parts: dict[str, str]) -> str:
    """A page below the head of all, its parts in the places of ``@NAME@``; what stands in a part stays as it is."""
    page, *rest = (page_asset("head.html") + page_asset(name)).split("@")
    for k, piece in enumerate(rest):
        page += parts[piece] if k % 2 == 0 else piece
    return page


def script_json(value: object) -> str:
    """A value as JSON that no text in it can lead out of its script element."""
    return json.dumps(value, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def bundle_text(name: str) -> str:
    """The text of a file of meshcat's: its viewer with three.js as one script, which defines ``MeshCat``; licences."""
    return (bundle_folder() / name).read_text(encoding="utf-8")


def bundle_folder() -> Path:
    """Where meshcat keeps its page."""
    return Path(meshcat.__file__).parent / "viewer" / "dist"
