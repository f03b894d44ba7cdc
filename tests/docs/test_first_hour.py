"""The tests that hold what once stopped new users exist."""

import re

from tests.docs.pages import ROOT


def test_named_tests_exist():
    page = (ROOT / "docs" / "experiments" / "first_hour.md").read_text(encoding="utf-8")
    found = re.findall(r"((?:`test_\w+`(?:, )?)+) in `(tests/[\w/]+\.py)`", page)
    assert sum(names.count(", ") + 1 for names, _ in found) > 30
    for names, file in found:
        text = (ROOT / file).read_text(encoding="utf-8")
        assert [name for name in re.findall(r"\w+", names) if f"def {name}(" not in text] == [], file
