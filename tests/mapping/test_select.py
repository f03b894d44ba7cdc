"""Which engine is taken when, and what is said about it."""

import logging
import sys
from dataclasses import replace

import numpy as np
import pytest

from anm_mj.errors import MapError
from anm_mj.mapping.backends import select
from anm_mj.mapping.backends.select import (
    choose_engine,
    make_backend,
    native_fault,
    triton_fault,
    with_available_engine,
)
from anm_mj.mapping.neural_map import NeuralMap


@pytest.fixture
def without_native(monkeypatch):
    monkeypatch.setattr(select, "native_fault", lambda: "it was not built")


@pytest.fixture
def with_native(monkeypatch):
    monkeypatch.setattr(select, "native_fault", lambda: None)


@pytest.fixture
def with_cuda(monkeypatch):
    monkeypatch.setattr("torch.cuda.is_available", lambda: True)


def test_native_on_a_cpu(with_native):
    assert choose_engine("auto", "cpu").name == "native"


@pytest.fixture
def without_triton(monkeypatch):
    monkeypatch.setattr(select, "triton_fault", lambda: "Triton is not installed")


def test_native_beside_a_gpu(with_native, with_cuda):
    assert choose_engine("auto", "auto").name == "native"


def test_torch_on_a_gpu_that_was_asked_for(with_native, with_cuda):
    assert choose_engine("auto", "cuda").name == "torch"


def test_triton_only_when_asked_for(without_native, with_cuda, monkeypatch):
    monkeypatch.setattr(select, "triton_fault", lambda: None)
    assert choose_engine("auto", "auto").name == "torch"
    assert choose_engine("triton", "auto").name == "triton"


def test_missing_triton_is_an_error(with_cuda, without_triton):
    with pytest.raises(MapError, match="asked for, but Triton is not installed; use engine"):
        choose_engine("triton", "cuda")


def test_triton_refuses_a_cpu(with_cuda):
    with pytest.raises(MapError, match="asked for, but it needs a CUDA device"):
        choose_engine("triton", "cpu")


def test_triton_needs_a_gpu(monkeypatch):
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    assert triton_fault() == "there is no CUDA device"


def test_triton_that_is_not_installed(with_cuda, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    monkeypatch.setattr("sys.platform", "linux")
    assert triton_fault() == "Triton is not installed (pip install triton)"
    monkeypatch.setattr("sys.platform", "win32")
    assert triton_fault() == "Triton is not made for win32"


@pytest.mark.parametrize(
    ("compiler", "told"), [(None, "install a C++17 compiler"), ("/usr/bin/c++", "though there is a compiler (/usr/bin")]
)
def test_native_that_was_not_built(compiler, told, monkeypatch):
    monkeypatch.setitem(sys.modules, "anm_mj._native", None)
    monkeypatch.setattr("shutil.which", lambda name: compiler)
    assert told in (native_fault() or "")
    assert "run make setup" in (native_fault() or "")


def test_named_engine_is_chosen(with_native, with_cuda):
    assert choose_engine("torch", "cpu").name == "torch"
    assert choose_engine("native", "auto").name == "native"


def test_torch_takes_over_with_a_warning(without_native, tiny_config, caplog):
    with caplog.at_level(logging.WARNING):
        backend = make_backend(tiny_config, seed=0, device="cpu")
    assert backend.name == "torch"
    (record,) = caplog.records
    assert "because the native engine is missing: it was not built" in record.getMessage()


def test_missing_native_is_an_error(without_native, tiny_config):
    with pytest.raises(MapError, match="asked for, but it was not built, or use engine 'torch'"):
        make_backend(replace(tiny_config, engine="native"), seed=0, device="cpu")


def test_native_refuses_a_gpu(with_native):
    with pytest.raises(MapError, match="it runs on the CPU"):
        choose_engine("native", "cuda")


def test_unknown_names():
    with pytest.raises(MapError, match="'fast', but it must be"):
        choose_engine("fast", "cpu")
    with pytest.raises(MapError, match="'tpu', but it must be"):
        choose_engine("auto", "tpu")


def test_config_of_a_missing_engine_becomes_auto(without_native, without_triton, tiny_config):
    assert with_available_engine(replace(tiny_config, engine="triton")).engine == "auto"
    assert with_available_engine(replace(tiny_config, engine="native")).engine == "auto"
    assert with_available_engine(replace(tiny_config, engine="torch")).engine == "torch"


def test_native_that_does_not_load(monkeypatch):
    def broken(name):
        raise ImportError("wrong ELF class")

    monkeypatch.setattr("importlib.import_module", broken)
    assert "it does not load (wrong ELF class)" in (native_fault() or "")


def test_engine_name(tiny_config):
    neural_map = NeuralMap(replace(tiny_config, engine="torch"), seed=0, device="cpu")
    assert neural_map.engine_name == "torch"


@pytest.mark.parametrize("engine", ["native", "torch"])
def test_an_engine_starts_from_given_parameters(tiny_config, engine):
    if engine == "native":
        pytest.importorskip("anm_mj._native")
    config = replace(tiny_config, engine=engine)
    given = make_backend(config, seed=1, device="cpu").get_state()
    state = make_backend(config, seed=0, device="cpu", state=given).get_state()
    own = make_backend(config, seed=0, device="cpu").get_state()
    assert all(np.array_equal(state[name], array) for name, array in given.items())
    assert not all(np.array_equal(own[name], array) for name, array in given.items())
