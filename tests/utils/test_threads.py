"""Tasks of another thread."""

import threading

import pytest

from anm_mj.utils import threads
from anm_mj.utils.threads import Background, usual_num_threads


def test_tasks_are_done_in_order_with_a_core_of_their_own():
    background, done, lent = Background("test", 2), [], []
    for number in range(20):
        background.submit(lambda number=number: done.append((number, threading.get_ident())))
    background.submit(lambda: lent.append(threads._lent))
    background.flush()
    assert [number for number, _ in done] == list(range(20))
    assert {thread for _, thread in done} != {threading.get_ident()}
    assert len({thread for _, thread in done}) == 1
    assert lent == [1]
    background.close()
    background.close()
    background.flush()
    assert threads._lent == 0


def test_who_is_too_far_ahead_waits():
    background, gate, given = Background("test", 3), threading.Event(), []

    def give():
        for number in range(6):
            background.submit(gate.wait)
            given.append(number)

    giver = threading.Thread(target=give)
    giver.start()
    giver.join(0.2)
    # One is being done, three wait.
    assert len(given) <= 4
    gate.set()
    giver.join()
    assert len(given) == 6
    background.close()


def test_an_error_is_told_later_and_nothing_is_done_after_it():
    background, done = Background("test", 4), []

    def fail():
        raise ValueError("no room on the disk")

    background.submit(fail)
    with pytest.raises(ValueError, match="no room"):
        background.flush()
    with pytest.raises(ValueError, match="no room"):
        background.submit(lambda: done.append(1))
    background.close()
    assert not done


@pytest.mark.parametrize(("asked", "given"), [("3", 3), ("2,1", 2), ("100000", 256), ("3000000000", 256)])
def test_no_more_threads_than_there_is_work_for(monkeypatch, asked, given):
    monkeypatch.setenv("OMP_NUM_THREADS", asked)
    assert usual_num_threads() == given
