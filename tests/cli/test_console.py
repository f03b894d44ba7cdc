"""Consoles of the command line, on which no file of others commands the terminal."""

import io

from rich.table import Table

from anm_mj.cli.console import PlainConsole, printable


def test_no_character_of_a_file_commands_the_terminal():
    assert printable("a\x1b]0;b\x07\u202ec\nd é") == "a\\x1b]0;b\\x07\\u202ec\nd é"


def test_neither_lines_nor_cells_of_tables_do():
    console = PlainConsole()
    console.width = 40
    console.file = io.StringIO()
    table = Table(box=None, show_header=False)
    table.add_row("stop reason", "a\x1b[2J")
    console.print("Wrote \x1b]0;b\x07[red]", highlight=False)
    console.print(table)
    said = console.file.getvalue()
    assert "Wrote \\x1b]0;b" in said
    assert "[red]" in said
    assert "a\\x1b[2J" in said
    assert said.replace("\n", "").isprintable()
