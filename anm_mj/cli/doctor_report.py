"""``anm-mj doctor --report``: what a bug report needs, as Markdown, without folders of the user."""

from __future__ import annotations

import platform
import re
from collections.abc import Sequence
from importlib import metadata

from rich.console import Console

from anm_mj.cli.doctor import Check
from anm_mj.io.manifest import git_revision
from anm_mj.utils.package_data import checkout

_FOLDER = re.compile(r"(?<![\w:/])~?(?:/[^\s/:'\"()]+)+/(?=[^\s/:'\"()])")
"""The folder of an absolute path; not the slashes of an address."""
_LAST = re.compile(r"(?<![\w:/…])~?/[^\s/:'\"()]+")
"""A path right below the root."""


def print_report(checks: Sequence[Check], console: Console) -> None:
    """Print :func:`report`, with lines as long as they are, so that they can be copied."""
    console.print(report(checks), soft_wrap=True, highlight=False)


def report(checks: Sequence[Check]) -> str:
    """The checks, and the versions of the packages that the program stands on.

    Args:
        checks: findings about this machine.
    """
    return "\n".join(
        [
            f"anm-mj {metadata.version('anm-mj')}{_revision()}, {platform.platform()}",
            "",
            "| check | state | found |",
            "|---|---|---|",
            *(f"| {check.name} | {check.state.value} | {_cell(f'{check.found} {check.advice}')} |" for check in checks),
            "",
            "Packages: " + ", ".join(f"{name} {version}" for name, version in _packages()),
        ]
    )


def without_folders(text: str) -> str:
    """A text in which every absolute path is cut down to its last part."""
    return _LAST.sub(lambda match: "…" + match[0][match[0].rindex("/") :], _FOLDER.sub("…/", text))


def _cell(text: str) -> str:
    return without_folders(" ".join(text.split())).replace("|", "\\|")


def _revision() -> str:
    folder = checkout()
    git = None if folder is None else git_revision(folder)
    return "" if git is None else f" (revision {git['revision'][:12]}{', changed' if git['changed'] else ''})"


def _packages() -> list[tuple[str, str]]:
    """Names and versions of the package's own dependencies, of the extras those that are installed."""
    found = {}
    for requirement in metadata.requires("anm-mj") or []:
        name = re.split(r"[^\w.-]", requirement, maxsplit=1)[0]
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return sorted(found.items())
