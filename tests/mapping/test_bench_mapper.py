"""What the engines' benchmark measures where, without measuring."""

import json
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from anm_mj.mapping.backends.select import native_fault
from anm_mj.mapping.keyframes import HostPixels

if native_fault() is not None:
    pytest.skip(f"the native engine cannot be used: {native_fault()}", allow_module_level=True)

from scripts import bench_mapper


def test_without_cuda_the_triton_engine_is_left_out_with_a_sentence(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    out = tmp_path / "bench.json"
    monkeypatch.setattr(sys, "argv", ["bench_mapper.py", "--engines", "triton", "--out", str(out)])
    assert bench_mapper.main() == 0
    assert "The Triton engine is left out: there is no CUDA device." in capsys.readouterr().out
    found = json.loads(out.read_text())
    assert (found["rows"], found["gpu"], found["roofline"]) == ([], None, {})


def test_with_cuda_its_rows_come_first_and_say_wall_time(monkeypatch, tmp_path):
    monkeypatch.setattr("torch.cuda.is_available", lambda: True)
    monkeypatch.setattr("torch.cuda.get_device_name", lambda: "a GPU")
    monkeypatch.setattr(bench_mapper, "triton_fault", lambda: None)
    asked = []

    def bench(make, threads, runs):
        asked.append(threads)
        return [bench_mapper.measure("nothing", SimpleNamespace(name="triton", device="cuda"), 1, 2, lambda k: k)]

    monkeypatch.setattr(bench_mapper, "bench_engine", bench)
    # Triton's compiler must not be loaded into a process that may have rendered by software.
    monkeypatch.setattr(bench_mapper, "engine_maker", lambda name, kernel, threads: None)
    out = tmp_path / "bench.json"
    monkeypatch.setattr(sys, "argv", ["bench_mapper.py", "--engines", "triton", "--out", str(out)])
    bench_mapper.main()
    found = json.loads(out.read_text())
    assert asked == [1]
    assert found["gpu"] == "a GPU"
    assert (found["rows"][0]["engine"], found["rows"][0]["clock"]) == ("triton", "wall")


def test_steps_with_their_draw_train_on_as_many_rays_as_a_map_does():
    sizes = []
    backend = SimpleNamespace(
        pixel_memory=HostPixels,
        steps=lambda batches, draws: sizes.extend(len(rays) for rays, _ in zip(batches, draws, strict=True)),
    )
    bench_mapper.replay_steps(backend, np.random.default_rng(0))(0)
    assert sizes == [538] * 5
