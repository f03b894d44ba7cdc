"""Where the log of a command goes."""

import io
import logging

from rich.console import Console

from anm_mj.cli.log import log_to


def test_a_record_is_one_line_as_it_stands_however_narrow_the_console(monkeypatch):
    monkeypatch.setattr(logging.root, "handlers", [])
    said = io.StringIO()
    log_to(Console(file=said, width=40), verbose=False)
    long = "/a/rather/long/path " * 10
    logging.getLogger("anm_mj.x").info("Wrote %s[red]", long)
    logging.getLogger("anm_mj.x").debug("a detail")
    logging.getLogger("another").info("its detail")
    assert said.getvalue() == f"Wrote {long}[red]\n"
