"""Which engine is taken when, and what is said about it."""

import logging
import sys
from dataclasses import replace

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


def test_a_cpu_gets_the_native_engine(with_native):
    assert choose_engine("auto", "cpu").name == "native"


@pytest.fixture
def with_triton(monkeypatch):
    monkeypatch.setattr(select, "triton_fault", lambda: None)


@pytest.fixture
def without_triton(monkeypatch):
    monkeypatch.setattr(select, "triton_fault", lambda: "its kernels do not run")


def test_a_gpu_gets_triton(with_native, with_cuda, with_triton):
    assert choose_engine("auto", "auto") == ("triton", "the quickest on a GPU", None)


def test_a_gpu_without_triton_gets_torch(with_native, with_cuda, without_triton):
    reason = "the Triton engine cannot be used: its kernels do not run"
    assert choose_engine("auto", "auto") == ("torch", reason, "triton")


def test_asking_for_triton_where_it_does_not_run_is_an_error(with_cuda, without_triton):
    assert choose_engine("torch", "cuda").name == "torch"
    with pytest.raises(MapError, match="asked for, but its kernels do not run; use engine"):
        choose_engine("triton", "cuda")
    with pytest.raises(MapError, match="asked for, but it needs a CUDA device"):
        choose_engine("triton", "cpu")


def test_triton_is_not_loaded_beside_a_software_renderer(with_cuda, monkeypatch):
    monkeypatch.setattr(select, "_software_renderer", lambda: True)
    assert "rendered in software before" in (triton_fault() or "")


def test_a_gpu_is_what_triton_is_for(monkeypatch):
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    assert triton_fault() == "there is no CUDA device"


def test_a_machine_with_cuda_but_without_triton_says_so(with_cuda, monkeypatch):
    monkeypatch.setattr(select, "_software_renderer", lambda: False)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    monkeypatch.setattr("sys.platform", "linux")
    assert triton_fault() == "Triton is not installed (pip install triton)"
    monkeypatch.setattr("sys.platform", "win32")
    assert triton_fault() == "Triton is not made for win32"


@pytest.mark.parametrize(
    ("compiler", "told"), [(None, "install a C++17 compiler"), ("/usr/bin/c++", "though there is a compiler (/usr/bin")]
)
def test_a_native_engine_that_was_not_built_says_what_is_missing(compiler, told, monkeypatch):
    monkeypatch.setitem(sys.modules, "anm_mj.mapping.backends._native", None)
    monkeypatch.setattr("shutil.which", lambda name: compiler)
    assert told in (native_fault() or "")
    assert "run make setup" in (native_fault() or "")


def test_what_is_named_is_taken(with_native, with_cuda):
    assert choose_engine("torch", "cpu").name == "torch"
    assert choose_engine("native", "auto").name == "native"


def test_torch_takes_over_with_one_warning(without_native, tiny_config, caplog):
    with caplog.at_level(logging.WARNING):
        backend = make_backend(tiny_config, seed=0, device="cpu")
    assert backend.name == "torch"
    (record,) = caplog.records
    assert "because the native engine is missing: it was not built" in record.getMessage()


def test_asking_for_a_missing_engine_is_an_error(without_native, tiny_config):
    with pytest.raises(MapError, match="asked for, but it was not built, or use engine 'torch'"):
        make_backend(replace(tiny_config, engine="native"), seed=0, device="cpu")


def test_the_native_engine_refuses_a_gpu(with_native):
    with pytest.raises(MapError, match="it runs on the CPU"):
        choose_engine("native", "cuda")


def test_unknown_names_are_refused():
    with pytest.raises(MapError, match="'fast', but it must be"):
        choose_engine("fast", "cpu")
    with pytest.raises(MapError, match="'tpu', but it must be"):
        choose_engine("auto", "tpu")


def test_a_map_of_an_engine_that_is_missing_loads_with_another(without_native, without_triton, tiny_config):
    assert with_available_engine(replace(tiny_config, engine="triton")).engine == "auto"
    assert with_available_engine(replace(tiny_config, engine="native")).engine == "auto"
    assert with_available_engine(replace(tiny_config, engine="torch")).engine == "torch"


def test_a_module_that_does_not_load_is_reported(monkeypatch):
    def broken(name):
        raise ImportError("wrong ELF class")

    monkeypatch.setattr("importlib.import_module", broken)
    assert "it does not load (wrong ELF class)" in (native_fault() or "")


def test_a_map_says_what_computes_it(tiny_config):
    neural_map = NeuralMap(replace(tiny_config, engine="torch"), seed=0, device="cpu")
    assert neural_map.engine_name == "torch"
