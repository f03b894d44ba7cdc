"""A run folder is written by one program at a time."""

import subprocess
import sys

import pytest

from anm_mj.errors import RunFolderError
from anm_mj.io.folder_hold import held

FORKING = """
import os, signal, sys, time
from pathlib import Path
from anm_mj.io.folder_hold import held
folder = Path(sys.argv[1])
with held(folder):
    child = os.fork()
    if child == 0:
        time.sleep(60.0)
        os._exit(0)
try:
    with held(folder):
        print("held again")
finally:
    os.kill(child, signal.SIGKILL)
"""


def test_a_folder_is_held_once(tmp_path):
    with held(tmp_path):
        with pytest.raises(RunFolderError, match="Another program is writing"), held(tmp_path):
            pass
        # Who was refused took nothing away from who holds it.
        with pytest.raises(RunFolderError, match="Another program is writing"), held(tmp_path):
            pass
    with held(tmp_path):
        pass
    with pytest.raises(RunFolderError, match="cannot be opened"), held(tmp_path / "none"):
        pass


def test_a_process_that_was_forked_meanwhile_does_not_keep_the_folder(tmp_path):
    done = subprocess.run([sys.executable, "-c", FORKING, str(tmp_path)], check=True, capture_output=True, text=True)
    assert done.stdout == "held again\n"
