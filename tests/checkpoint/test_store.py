import logging
import math
import os
import shutil
from types import SimpleNamespace

import numpy as np
import pytest

from anm_mj.checkpoint import checkpoint_file
from anm_mj.checkpoint.checkpoint_config import CheckpointConfig
from anm_mj.checkpoint.checkpoint_file import read_checkpoint
from anm_mj.checkpoint.encode import encode
from anm_mj.checkpoint.known_classes import KnownClasses
from anm_mj.checkpoint.store import Checkpointer, CheckpointStore
from anm_mj.errors import CheckpointError, RunFolderError

STATE = {"numbers": np.arange(1000.0), "step": 7}


@pytest.fixture
def store(tmp_path):
    store = CheckpointStore(tmp_path / "run" / "checkpoint")
    store.folder.parent.mkdir()
    return store


def write(store, *steps):
    for step in steps:
        store.complete(step, store.draft(step, {"wall_s": 1.0}, encode({"root": [STATE, step]})))


def test_the_two_newest_are_kept_and_the_newest_is_read(store):
    write(store, 100, 200, 300)
    assert sorted(path.name for path in store.folder.iterdir()) == ["000200.checkpoint", "000300.checkpoint"]
    state = store.newest()
    assert (state.step, state.facts) == (300, {"wall_s": 1.0})
    assert state.arrays[0].tobytes() == STATE["numbers"].tobytes()


@pytest.mark.parametrize("place", [0, 25, 40, 300, 3000, -40, -1])
def test_a_flipped_bit_anywhere_falls_back_to_the_one_before_and_says_so(store, caplog, place):
    write(store, 100, 200)
    newest = store.folder / "000200.checkpoint"
    data = bytearray(newest.read_bytes())
    data[place] ^= 4
    newest.write_bytes(data)
    assert store.newest().step == 100
    assert "000200.checkpoint is left out" in caplog.text
    assert "the one before is used" in caplog.text


@pytest.mark.parametrize("size", [0, 5, 20, 27, 200, 5000, -1])
def test_a_file_that_was_cut_off_falls_back_too(store, size):
    write(store, 100, 200)
    newest = store.folder / "000200.checkpoint"
    newest.write_bytes(newest.read_bytes()[:size])
    assert store.newest().step == 100


def test_without_a_whole_one_the_error_says_what_to_do(store):
    with pytest.raises(CheckpointError, match="has no checkpoint to resume from; start the run again"):
        store.newest()
    write(store, 100)
    (store.folder / "000100.checkpoint").write_bytes(b"anm-mj checkpoint 0\n")
    with pytest.raises(CheckpointError, match="has no whole checkpoint"):
        store.newest()


def test_a_checkpoint_that_does_not_fit_its_folder_is_left_out(store):
    def accept(state):
        if state.step > 100:
            raise CheckpointError("The logs are shorter.")

    write(store, 100, 200)
    assert store.newest(accept).step == 100


def test_those_that_were_left_out_go_once_an_older_one_is_used(store):
    write(store, 100, 200, 1_000_000)
    assert [store.has_after(step) for step in (200, 1_000_000)] == [True, False]
    store.drop_after(200)
    assert [path.name for path in store.folder.iterdir()] == ["000200.checkpoint"]


def test_half_a_file_is_never_seen_and_a_full_disk_leaves_the_old_one(store, monkeypatch):
    write(store, 100)

    def full(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(checkpoint_file.os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        write(store, 200)
    assert [path.name for path in store.folder.iterdir()] == ["000100.checkpoint"]


def test_all_are_removed_at_the_end(store):
    write(store, 100, 200)
    (store.folder / ".000300.checkpoint.abc").write_bytes(b"half")
    store.remove()
    assert not store.folder.exists()


def test_the_state_is_what_it_was_when_the_checkpoint_was_taken(store):
    numbers = np.zeros(100_000)
    make(store, {"root": [numbers]}).after_step(0, 0.0)
    numbers[:] = 1.0
    wait(store)
    assert not store.newest().arrays[0].any()


def test_what_a_failed_checkpoint_was_to_force_to_the_disk_is_left_to_the_next(store, monkeypatch):
    checkpointer = make(store, {"root": [1]}, every_steps=1)
    assert checkpointer.synced_step == -1
    checkpointer.after_step(0, 0.0)
    checkpointer.close()
    assert checkpointer.synced_step == 0

    def full(step, draft):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(store, "complete", full)
        checkpointer.after_step(5, 1e6)
        checkpointer.close()
    assert (checkpointer.last_step, checkpointer.synced_step) == (5, 0)
    checkpointer.after_step(9, 1e6)
    checkpointer.close()
    assert checkpointer.synced_step == 9


def test_a_disk_without_room_for_the_first_is_said_before_the_next_step(store, monkeypatch):
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: SimpleNamespace(free=0))
    with pytest.raises(RunFolderError, match=r"No checkpoint can be written .* more than the disk has free"):
        make(store, {"root": [1]}).after_step(0, 0.0)


def make(store, roots, **settings):
    return Checkpointer(store, CheckpointConfig(**settings), lambda: roots, lambda: ({}, []), KnownClasses())


def wait(store):
    for _ in range(1000):
        if any(path.suffix == ".checkpoint" and path.name[0] != "." for path in store.folder.glob("*")):
            return
        os.sched_yield()
        __import__("time").sleep(0.01)


def test_checkpoints_come_every_so_many_steps_and_never_cost_more_than_their_share(store):
    checkpointer = make(store, {"root": [1]}, every_steps=10, loop_share=0.5)
    taken = []
    checkpointer._take = lambda step: taken.append(step) or setattr(checkpointer, "last_step", step)
    for step in range(31):
        checkpointer.after_step(step, float(step))
    assert taken == [0, 10, 20, 30]
    # It took 4 s: another one of 8 s is within half of the loop's time from 24 s on.
    checkpointer.spent_s, checkpointer._spent_before_s = 4.0, 0.0
    taken.clear()
    for step in range(31, 70):
        checkpointer.after_step(step, float(step - 30))
    assert taken == [54, 64]


def test_no_checkpoint_is_taken_where_none_is_wanted(store):
    checkpointer = make(store, {"root": [1]}, every_steps=0)
    checkpointer.after_step(0, 0.0)
    checkpointer.finish(0, resumable=True)
    assert not store.folder.exists()


def test_state_that_cannot_be_stored_is_said_once_and_told_to_who_resumes(store, caplog):
    checkpointer = make(store, {"policy": [iter([])]}, every_steps=1)
    with caplog.at_level(logging.WARNING):
        checkpointer.after_step(0, 0.0)
        checkpointer.after_step(1, 0.0)
    assert caplog.text.count("cannot be resumed") == 1
    with pytest.raises(CheckpointError, match=r"cannot be resumed: policy\[\] is a builtins:list_iterator"):
        store.newest()


def test_a_failed_write_is_one_warning_and_the_run_goes_on(store, caplog, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(store, "complete", full)
    checkpointer = make(store, {"root": [1]})
    checkpointer.after_step(0, 0.0)
    checkpointer.finish(0, resumable=True)
    assert "No checkpoint was written at step 0 (No space left on device)" in caplog.text


def test_a_later_one_that_cannot_be_drafted_is_one_warning_and_the_run_goes_on(store, caplog, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    checkpointer = make(store, {"root": [1]})
    checkpointer.after_step(0, 0.0)
    checkpointer.close()
    monkeypatch.setattr(store, "draft", full)
    for step in (1000, 1001):
        checkpointer.after_step(step, math.inf)
    checkpointer.finish(1001, resumable=False)
    assert caplog.text.count("No checkpoint was written at step 1000 (No space left on device)") == 1


def test_a_header_of_any_size_costs_no_memory(tmp_path):
    path = tmp_path / "x.checkpoint"
    path.write_bytes(checkpoint_file.MAGIC + (1 << 62).to_bytes(8, "little") + b"{}")
    with pytest.raises(CheckpointError, match="cut off"):
        read_checkpoint(path)


def test_a_checkpoint_of_a_million_steps_is_newer(tmp_path):
    store = CheckpointStore(tmp_path)
    for step in (999_900, 1_000_000):
        (tmp_path / f"{step:06d}.checkpoint").touch()
    assert [path.stem for path in store._newest_first()] == ["1000000", "999900"]
