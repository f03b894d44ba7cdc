"""Which engine is taken when, and what is said about it."""

from dataclasses import replace

import numpy as np
import pytest

from anm_mj.errors import MapError
from anm_mj.mapping.backends.select import choose_engine, make_backend
from anm_mj.mapping.neural_map import NeuralMap


@pytest.fixture
def with_cuda(monkeypatch):
    monkeypatch.setattr("torch.cuda.is_available", lambda: True)


def test_native_beside_a_gpu(with_cuda):
    assert choose_engine("auto", "auto") == "native"
    assert choose_engine("auto", "cpu") == "native"


def test_torch_on_a_gpu_that_was_asked_for(with_cuda):
    assert choose_engine("auto", "cuda") == "torch"


def test_named_engine_is_chosen(with_cuda):
    assert choose_engine("torch", "cpu") == "torch"
    assert choose_engine("native", "auto") == "native"


def test_native_refuses_a_gpu():
    with pytest.raises(MapError, match="it runs on the CPU"):
        choose_engine("native", "cuda")


def test_unknown_device():
    with pytest.raises(MapError, match="'tpu', but it must be"):
        choose_engine("auto", "tpu")


def test_engine_name(tiny_config):
    neural_map = NeuralMap(replace(tiny_config, engine="torch"), seed=0, device="cpu")
    assert neural_map.backend.name == "torch"


@pytest.mark.parametrize("engine", ["native", "torch"])
def test_an_engine_starts_from_given_parameters(tiny_config, engine):
    config = replace(tiny_config, engine=engine)
    given = make_backend(config, seed=1, device="cpu").parameters()
    state = make_backend(config, seed=0, device="cpu", parameters=given).parameters()
    own = make_backend(config, seed=0, device="cpu").parameters()
    assert all(np.array_equal(state[name], array) for name, array in given.items())
    assert not all(np.array_equal(own[name], array) for name, array in given.items())
