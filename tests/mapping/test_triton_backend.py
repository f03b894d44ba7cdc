"""The Triton engine against the torch engine, which is the reference; in the interpreter where there is no GPU."""

import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import torch

if importlib.util.find_spec("triton") is None:
    pytest.skip(f"Triton is not made for {sys.platform}", allow_module_level=True)

pytestmark = pytest.mark.slow  # Opt-in, and the interpreter takes a minute.

CONFIGS = ("guided", "uniform")
TRUNCATION_SHARE = 1e-4


def _run(module: str, environment: dict[str, str]) -> dict:
    """The JSON that a module prints."""
    done = subprocess.run(
        [sys.executable, "-m", module],
        cwd=Path(__file__).resolve().parents[2],
        env=environment,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr[-4000:]
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def found() -> dict:
    """What a process of its own found: pytest's may have rendered in software, after which Triton crashes."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    if not torch.cuda.is_available():
        environment["TRITON_INTERPRET"] = "1"
    return _run("tests.mapping.triton_parity", environment)


all_configs = pytest.mark.parametrize("config", CONFIGS)


@all_configs
def test_sample_depths_are_those_of_the_torch_engine_bit_for_bit(config, found):
    assert found[config]["same_samples"]


@all_configs
@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_losses_and_gradients_are_those_of_autograd(config, dtype, found):
    assert found[config][f"losses_{dtype}"] < 1e-5
    gradients = found[config][f"gradients_{dtype}"]
    assert set(gradients) == {"table", "sdf_hidden", "sdf_out", "color_hidden", "color_out"}
    for name, error in gradients.items():
        assert error < 1e-5, name


@all_configs
def test_queries_answer_as_the_torch_engine_does(config, found):
    for query in ("query_sdf", "query_rgb", "query_hidden", "query_perturbed"):
        assert found[config][query] < 2e-5, query
    assert found[config]["query_sensitivity"] < 1e-3
    assert found[config]["render"] < 1e-3
    assert found[config]["empty"] == [0, 0]


@all_configs
def test_steps_lead_to_the_same_surface(config, found):
    assert found[config]["losses_after_steps"] < 1e-3
    assert found[config]["sdf_after_steps"] < TRUNCATION_SHARE


@all_configs
def test_checkpoints_move_both_ways(config, found):
    assert found[config]["state_kept"]
    assert found[config]["state_returns"]
    assert found[config]["answers_return"] < 1e-6


@all_configs
def test_a_graph_captured_once_trains_on_a_store_that_grows_and_is_thinned(config, found):
    replay = found[config]["replay"]
    assert replay["on_device"]
    assert replay["kept"] == [256, 256, 128, 128]
    assert replay["captured"]
    assert replay["losses"] < 1e-3


@pytest.mark.skipif(torch.cuda.is_available(), reason="a GPU's own graphs do not say what is in them")
@all_configs
def test_all_steps_but_the_first_are_replays_of_one_graph_that_waits_for_nothing(config, found):
    replay = found[config]["replay"]
    # The first of eight steps compiles.
    assert replay["replays"] == 7
    # Nothing that waits for the device, or reads the host's memory, which a capture would refuse or not do again.
    for name in replay["names"]:
        assert not any(word in name for word in ("local_scalar", "lift_fresh", "_to_copy")), name


def test_a_map_trains_on_pixels_that_the_engine_keeps_as_on_those_of_the_host(found):
    assert found["map"]["losses"] < 1e-3
    assert found["map"]["sizes"] == [9, 9]


def test_what_does_not_fit_is_refused(found):
    shape, lacking, wide = found["refusals"]
    assert "'table' has shape (10, 2)" in shape
    assert "lacks 'table'" in lacking
    assert "2000 are configured; use engine 'torch'" in wide


def test_the_engine_is_found_fit_and_made(found):
    assert found["fault"] is None
    assert found["choice"] == "triton"
    assert found["made"][0] == "triton"


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU to run on")
def test_kernels_compile_for_a_gpu_that_is_not_there():
    """The interpreter takes much that the compiler does not."""
    environment = {name: value for name, value in os.environ.items() if name != "TRITON_INTERPRET"}
    kernels = _run("tests.mapping.triton_compile", environment)
    assert set(kernels) == {
        f"{name}_kernel" for name in ("sample", "encode", "scatter", "train", "decode", "adam_table", "adam_decoders")
    }
    # Both features of an entry in one atomic.
    assert kernels["scatter_kernel"]["paired_atomics"]
