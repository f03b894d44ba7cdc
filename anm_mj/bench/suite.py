"""Suites: comparisons that come with the package, so that everybody can repeat them.

``tune`` is for choosing settings. ``test`` is for judging them: other seeds, never used for a choice. ``large`` holds
buildings of 40 to 60 rooms. In ``people``, people walk about. ``real`` has the buildings of ``test`` in the real world.
``smoke`` takes minutes. All these are on generated scenes; ``open`` is on scenes of others, which the user imports.
"""

from pathlib import Path

from anm_mj.bench.bench_error import BenchError

_FOLDER = Path(__file__).parent / "suites"


def suite_names() -> tuple[str, ...]:
    """Names of the suites."""
    return tuple(sorted(path.stem for path in _FOLDER.glob("*.toml")))


def suite_file(name: str) -> Path:
    """The file of a suite. Raises BenchError if there is no such suite."""
    if name not in suite_names():
        raise BenchError(f"There is no suite {name!r}; give one of {', '.join(suite_names())}.")
    return _FOLDER / f"{name}.toml"
