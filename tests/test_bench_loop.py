"""The watch of scripts/bench_loop.py."""

import time

from rich.console import Console

from scripts.bench_loop import STAGES, Budget, Watch, print_budget


class Work:
    def outer(self):
        time.sleep(0.02)
        return self.inner + self.inner

    @property
    def inner(self):
        time.sleep(0.03)
        return 1


def test_a_stage_is_timed_without_those_within_it():
    watch = Watch()
    watch.over(Work, "outer", "outer")
    watch.over(Work, "inner", "inner")
    assert Work().outer() == 2
    assert watch.calls == {"outer": 1, "inner": 2}
    assert watch.seconds["inner"] >= 0.06
    assert 0.02 <= watch.seconds["outer"] < watch.seconds["inner"]


def test_every_stage_has_a_line():
    console = Console(record=True, width=120)
    print_budget(Budget("home", 10, 50.0, dict.fromkeys(STAGES, 1.0), {"train": 0.5}), console)
    text = console.export_text()
    assert all(stage in text for stage in STAGES)
    assert "2.0" in text
    assert "50.0 a second" in text
