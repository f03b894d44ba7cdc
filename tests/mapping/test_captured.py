from contextlib import contextmanager

import pytest

from anm_mj.mapping.backends.triton.captured import Captured


@pytest.fixture
def events(monkeypatch) -> list[str]:
    """What happens, with stand-ins for torch's graphs."""
    noted = []

    class Graph:
        def replay(self):
            noted.append("replay")

    @contextmanager
    def capture(graph):
        assert isinstance(graph, Graph)
        noted.append("capture")
        yield
        noted.append("captured")

    monkeypatch.setattr("torch.cuda.CUDAGraph", Graph)
    monkeypatch.setattr("torch.cuda.graph", capture)
    return noted


def test_launches_compile_first_are_captured_next_and_replayed_from_then_on(events):
    captured = Captured(lambda: events.append("launch"), enabled=True)
    for _ in range(4):
        captured.run()
    assert events == ["launch", "capture", "launch", "captured", "replay", "replay", "replay"]


def test_without_cuda_nothing_is_captured(events):
    captured = Captured(lambda: events.append("launch"), enabled=False)
    for _ in range(3):
        captured.run()
    assert events == ["launch"] * 3


def test_a_capture_that_fails_is_tried_again_and_not_replayed(events):
    failing = [False, True, False]

    def launch():
        events.append("launch")
        if failing.pop(0):
            raise RuntimeError("out of memory")

    captured = Captured(launch, enabled=True)
    captured.run()
    with pytest.raises(RuntimeError, match="out of memory"):
        captured.run()
    captured.run()
    assert events == ["launch", "capture", "launch", "capture", "launch", "captured", "replay"]
