"""What holds for all readers of scenes."""

import re
from pathlib import Path

import pytest

from anm_mj.scene.importing import readers

FILES = sorted(Path(readers.__path__[0]).rglob("*.py"))


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.name)
def test_no_reader_reads_a_file_without_asking_what_it_is(file):
    """A FIFO is waited for, and /dev/zero never ends; ``utils/read_file.py`` refuses both."""
    assert not re.findall(r"\.read_(?:text|bytes)\(", file.read_text(encoding="utf-8"))
