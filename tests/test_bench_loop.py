"""The watch of scripts/bench_loop.py."""

import threading
import time

from rich.console import Console

from scripts.bench_loop import AROUND, STAGES, Budget, Watch, print_budget


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


def test_other_threads_have_a_sum_of_their_own():
    watch = Watch()
    thread = threading.Thread(target=lambda: watch.run("inner", lambda: time.sleep(0.03)))

    def outer():
        thread.start()
        thread.join()

    watch.run("outer", outer)
    assert watch.seconds["outer"] >= 0.03
    assert watch.beside["inner"] >= 0.03
    assert "inner" not in watch.seconds


def test_every_stage_has_a_line():
    console = Console(record=True, width=120)
    ones, around = dict.fromkeys(STAGES, 1.0), dict.fromkeys(AROUND, 2.0)
    beside = {**dict.fromkeys(AROUND, 0.0), "pictures": 4.75}
    print_budget(
        Budget(
            "home",
            10,
            50.0,
            60.0,
            ones,
            {"renderer": 3.25},
            dict(ones, people=7.5),
            34.5,
            {"train": 0.5},
            around,
            beside,
            700.0,
        ),
        console,
    )
    text = console.export_text()
    assert all(name in text for name in (*STAGES, *AROUND))
    assert "3.25" in text
    assert "4.8" in text
    assert "60.0 without recording" in text
    assert "2.0" in text
    assert "50.0 a second" in text
    assert "7.50" in text
    assert "34.50" in text


def test_processor_time_is_that_of_all_threads_without_sleep():
    watch = Watch()

    def work():
        begin = time.thread_time()
        while time.thread_time() - begin < 0.03:
            pass

    thread = threading.Thread(target=lambda: watch.run("inner", work))

    def outer():
        thread.start()
        thread.join()
        watch.run("inner", work)

    watch.run("outer", outer)
    assert 0.06 <= watch.cpu["inner"] < 0.2
    assert watch.cpu["outer"] < 0.03


def test_what_does_not_occur_has_no_line():
    console = Console(record=True, width=120)
    stages = dict.fromkeys(STAGES, 1.0) | {"people": 0.0}
    print_budget(
        Budget(
            "home",
            10,
            5.0,
            6.0,
            stages,
            {},
            stages,
            3.0,
            {},
            dict.fromkeys(AROUND, 1.0),
            dict.fromkeys(AROUND, 0.0),
            7.0,
        ),
        console,
    )
    assert "people" not in console.export_text()
