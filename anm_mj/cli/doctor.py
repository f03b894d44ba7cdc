"""``anm-mj doctor``: what this machine has, as a table, or as Markdown for a bug report without folders of the user."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from anm_mj.cli.command_line import Report
from anm_mj.utils.markdown import table

if TYPE_CHECKING:
    from rich.console import Console

    from anm_mj.cli.machine_checks import Check

_FOLDER = re.compile(r"(?<![\w:/])~?(?:/[^\s/:'\"()]+)+/(?=[^\s/:'\"()])")
"""The folder of an absolute path; not the slashes of an address."""
_LAST = re.compile(r"(?<![\w:/…])~?/[^\s/:'\"()]+")
"""A path right below the root."""


def doctor(*, report: bool = False) -> Report:
    """Check what this machine has, and what a run will use.

    The exit status is 1 if a run is impossible.

    Args:
        report: for a bug report: Markdown, without your folders
    """
    from anm_mj.cli.console import UNUSABLE, PlainConsole
    from anm_mj.cli.machine_checks import State, diagnose

    console = PlainConsole()
    with console.status("Checking this machine"):
        checks = diagnose()
    if report:
        console.say(report_text(checks))
    else:
        print_checks(checks, console)
    return Report(checks, UNUSABLE if any(check.state is State.BAD for check in checks) else 0)


def print_checks(checks: Sequence[Check], console: Console) -> None:
    """Print the checks as a table, then the engine and camera of a run, or the checks to fix first."""
    from rich.table import Table
    from rich.text import Text

    from anm_mj.cli.machine_checks import State

    styles = {State.GOOD: "green", State.NOTE: "yellow", State.BAD: "red"}
    table = Table(box=None, padding=(0, 2, 0, 0), show_header=False)
    for check in checks:
        advice = f"\n{check.advice}" if check.advice else ""
        # As Text: error messages may contain rich markup.
        table.add_row(Text(check.state.value, styles[check.state]), check.name, Text(f"{check.found}{advice}"))
    console.print(table)
    wrong = [check.name for check in checks if check.state is State.BAD]
    if wrong:
        console.print(f"\nA run is impossible here; to fix first: {', '.join(wrong)}.", style="bold red")
    else:
        used = {check.name: check.found for check in checks}
        console.print(f"\nA run will use: {used['map engine']}; pictures by {used['pictures by']}.", style="bold")


def report_text(checks: Sequence[Check]) -> str:
    """The checks, and the versions of the packages that the program stands on, as Markdown."""
    import platform

    found = (without_folders(" ".join(f"{check.found} {check.advice}".split())) for check in checks)
    rows = [(check.name, check.state.value, text) for check, text in zip(checks, found, strict=True)]
    packages = ", ".join(f"{name} {version}" for name, version in _packages())
    head = f"anm-mj {version()}, {platform.platform()}"
    checked = table(("check", "state", "found"), rows, text_columns=(0, 1, 2))
    return "\n\n".join([head, checked, f"Packages: {packages}"])


def version() -> str:
    """The version, and of a checkout its revision."""
    from importlib import metadata

    from anm_mj.io.manifest import git_revision
    from anm_mj.utils.package_data import checkout

    folder = checkout()
    git = None if folder is None else git_revision(folder)
    revision = f" (revision {git['revision'][:12]}{', changed' if git['changed'] else ''})" if git else ""
    return metadata.version("anm-mj") + revision


def without_folders(text: str) -> str:
    """A text in which every absolute path is cut down to its last part, and the folder one works in and one's home to
    nothing: these may have blanks, where others end.
    """
    for folder, word in ((Path.cwd(), "."), (Path.home(), "~")):
        # Not the root, which is in every path.
        text = text.replace(str(folder), word) if len(folder.parts) > 1 else text
    return _LAST.sub(lambda match: "…" + match[0][match[0].rindex("/") :], _FOLDER.sub("…/", text))


def _packages() -> list[tuple[str, str]]:
    """Names and versions of the package's own dependencies, of the extras those that are installed."""
    from importlib import metadata

    found = {}
    for requirement in metadata.requires("anm-mj") or []:
        name = re.split(r"[^\w.-]", requirement, maxsplit=1)[0]
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return sorted(found.items())
