"""What is shipped and what it stands on have licences that docs/licences.md lists."""

import re
import tomllib
from importlib import metadata
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
FOR_DEVELOPERS = ("dev",)


def listed() -> dict[str, tuple[str, ...]]:
    rows = re.findall(r"^\| ([\w.-]+) \| ([\w ,]+) \|", (ROOT / "docs/licences.md").read_text(), re.MULTILINE)
    return {name: tuple(licence.split(", ")) for name, licence in rows if name != "package"}


def needed() -> set[str]:
    extras = PROJECT["optional-dependencies"]
    wanted = PROJECT["dependencies"] + [one for extra in extras if extra not in FOR_DEVELOPERS for one in extras[extra]]
    return {re.split(r"[^\w.-]", one, maxsplit=1)[0] for one in wanted} - {PROJECT["name"]}


def said_by(package: str) -> str:
    """All that a package says of its licence, the text of its licence file included."""
    meta = metadata.metadata(package)
    names = ("License-Expression", "License", "Classifier")
    fields = [field for name in names for field in meta.get_all(name) or []]
    files = [
        file for file in metadata.files(package) or [] if re.search(r"licen[cs]e|copying", file.name, re.IGNORECASE)
    ]
    texts = [
        Path(str(file.locate())).read_text(errors="replace") for file in files if Path(str(file.locate())).is_file()
    ]
    return "\n".join(fields + texts)


def test_every_dependency_is_listed_and_nothing_else():
    assert set(listed()) == needed()


@pytest.mark.parametrize("package", sorted(needed()))
def test_a_package_has_the_licence_that_is_listed(package):
    try:
        said = said_by(package)
    except metadata.PackageNotFoundError:
        pytest.skip(f"{package} is not installed")
    # The text of the BSD licence does not name it.
    said += " BSD" if "Redistribution and use in source and binary forms" in said else ""
    for licence in listed()[package]:
        assert licence in said


def test_scenes_are_our_own():
    for scene in sorted((ROOT / "scenes").glob("*/scene.toml")):
        assert tomllib.loads(scene.read_text())["licence"] == PROJECT["license"]
