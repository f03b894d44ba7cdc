"""What the engines' benchmark measures where, without measuring."""

import json
import sys
from types import SimpleNamespace

import numpy as np

from scripts import bench_mapper


def test_rows_say_engine_and_clock(monkeypatch, tmp_path):
    backend = SimpleNamespace(name="torch")

    def bench(make, threads, runs):
        return [bench_mapper.measure("nothing", backend, threads, 2, lambda k: k)]

    monkeypatch.setattr(bench_mapper, "bench_engine", bench)
    out = tmp_path / "bench.json"
    monkeypatch.setattr(sys, "argv", ["bench_mapper.py", "--engines", "torch", "--out", str(out)])
    assert bench_mapper.main() == 0
    found = json.loads(out.read_text())
    assert [(row["engine"], row["threads"], row["clock"]) for row in found["rows"]] == [
        ("torch", 1, "cpu"),
        ("torch", 2, "wall"),
    ]
    assert found["roofline"] == {}


def test_steps_with_their_draw_train_on_as_many_rays_as_a_map_does():
    sizes = []
    backend = SimpleNamespace(
        steps=lambda batches, draws: sizes.extend(len(rays) for rays, _ in zip(batches, draws, strict=True)),
    )
    bench_mapper.replay_steps(backend, np.random.default_rng(0))(0)
    assert sizes == [538] * 5
