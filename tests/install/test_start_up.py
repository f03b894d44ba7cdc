"""What commands load before they answer: a run with the native engine does without torch, ``--help`` without numpy."""

import subprocess
import sys

import pytest

SCHEDULE = ["--set", "mapping.schedule.first_iterations=5", "--set", "mapping.schedule.final_iterations=0"]
QUICK = ["--set", "image_px=32", *SCHEDULE]


def loaded(program, place):
    """The modules that a program of its own has loaded at its end."""
    program += "\nimport sys; print(*sys.modules, file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", program], cwd=place, capture_output=True, text=True, timeout=200)
    assert done.returncode == 0, done.stderr
    return set(done.stderr.splitlines()[-1].split())


def test_import(tmp_path):
    assert loaded("import anm_mj", tmp_path).isdisjoint({"numpy", "mujoco", "torch", "trimesh", "rich"})


def test_help(tmp_path):
    for words in ("['--help']", "['explore', '--help']"):
        program = f"from anm_mj.cli.main import main\nassert main({words}) == 0"
        assert loaded(program, tmp_path).isdisjoint({"numpy", "mujoco", "torch", "trimesh", "rich"})


def test_without_the_compiled_module_a_run_ends_with_one_sentence(tmp_path):
    program = (
        "import sys; sys.modules['anm_mj._native'] = None\n"
        "from anm_mj.cli.main import main; sys.exit(main(sys.argv[1:]))"
    )
    words = ["explore", "room", "--steps", "2", "--out", "run"]
    done = subprocess.run([sys.executable, "-c", program, *words], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr.startswith("anm-mj: The compiled part of anm-mj is missing")
    assert "install a C++17 compiler" in done.stderr
    assert "Traceback" not in done.stderr


def test_the_loop_begins_without_what_reads_scenes_and_draws(tmp_path):
    program = (
        "import sys\n"
        "import anm_mj.run\n"
        "from anm_mj.cli.main import main\n"
        "explore = anm_mj.run.explore\n"
        "def begin(*args, **options):\n"
        "    found.update(sys.modules)\n"
        "    return explore(*args, **options)\n"
        "found, anm_mj.run.explore = set(), begin\n"
        f"assert main({['explore', 'room', '--steps', '2', '--out', 'run', *QUICK]}) == 0\n"
        "assert found, 'no loop has begun'\n"
        "unneeded = found & {'trimesh', 'networkx', 'shapely', 'lxml', 'matplotlib'}\n"
        "assert not unneeded, unneeded\n"
    )
    loaded(program, tmp_path)


@pytest.mark.slow
def test_a_run_with_the_native_engine_loads_no_torch(tmp_path):
    words = ["explore", "room", "--steps", "2", "--out", "run", "--set", "mapping.engine=native", *QUICK]
    modules = loaded(f"from anm_mj.cli.main import main\nassert main({words}) == 0", tmp_path)
    assert "anm_mj._native" in modules
    assert "torch" not in modules
    assert (tmp_path / "run" / "map.safetensors").is_file()
