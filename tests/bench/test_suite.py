import itertools
import re
import shlex
import subprocess
from pathlib import Path

import pytest

from anm_mj.bench.suite import GeneratedScene, ImportedScene, find_imported, provide, suite_file, suite_names
from anm_mj.bench.sweep import BenchError, read_jobs, read_sweeps
from anm_mj.cli import command_line
from anm_mj.cli.main import COMMANDS, PROGRAM
from anm_mj.errors import SceneError
from anm_mj.scene.budget import BASE_STEPS, STEPS_PER_M2, default_steps
from anm_mj.sim.simulation_config import REALITIES
from tests.scene.small import make_small_scene

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def read_suite(name):
    """The sweeps of a suite, and its scenes that are generated."""
    sweeps, scenes = read_sweeps(suite_file(name))
    return sweeps, {key: scene for key, scene in scenes.items() if isinstance(scene, GeneratedScene)}


def test_every_suite_has_scenes_with_hashes():
    assert set(suite_names()) == {"smoke", "tune", "test", "variants", "real", "large", "open", "people"}
    seeds = []
    for name in set(suite_names()) - {"open", "real", "variants"}:
        sweeps, generated = read_suite(name)
        used = {scene for sweep in sweeps for scene in sweep.scenes}
        assert used == set(generated)
        assert all(len(scene.hash) == 64 for scene in generated.values())
        seeds += [scene.seed for scene in generated.values()]
    assert len(seeds) == len(set(seeds))


def test_the_real_world_is_tried_in_the_buildings_that_judge(cache):
    sweeps, generated = read_suite("real")
    assert generated == read_suite("test")[1]
    assert all(set(sweep.scenes) == set(generated) for sweep in sweeps)
    world = REALITIES["real"]
    alone = [sweep for sweep in sweeps if sweep.policies == ["gvg"]]
    ideal, real, *others = alone
    assert (ideal.reality, ideal.settings, real.reality) == ("ideal", (), "real")
    assert {name: getattr(real, name)[0] for name in world.options} == world.options
    assert real.settings == world.texts
    # One at a time: together they are the real world.
    changed = [{name for name in world.options if getattr(one, name) != getattr(ideal, name)} for one in others]
    assert sorted(name for names in changed for name in names) == sorted(world.options)
    assert sorted(text for one in others for text in one.settings) == sorted(world.texts)
    # Each mesh is compared with that of the ideal run.
    assert all(sweep.maps or sweep.policies == ["gvg"] for sweep in sweeps)


def read_open():
    """The sweeps of suite open, and its scenes, all of others."""
    sweeps, scenes = read_sweeps(suite_file("open"))
    imported = {name: scene for name, scene in scenes.items() if isinstance(scene, ImportedScene)}
    assert len(imported) == len(scenes)
    return sweeps, imported


def test_scenes_of_others_say_where_they_come_from():
    sweeps, imported = read_open()
    assert {scene for sweep in sweeps for scene in sweep.scenes} == set(imported)
    assert len({scene.repository for scene in imported.values()}) >= 8
    assert len({scene.hash for scene in imported.values()}) == len(imported)
    for name, scene in imported.items():
        assert len(scene.hash) == 64
        assert not set(scene.commit) <= {"0"}
        clone, checkout, make = scene.instructions.split("\n")
        assert clone.split() == ["git", "clone", scene.repository, f"{name}_source"]
        assert checkout.endswith(scene.commit)
        words = shlex.split(make)
        assert words[:5] == ["anm-mj", "scene", "import", scene.file, f"$ANM_MJ_SCENES/{name}"]
        command_line.parse(*command_line.find(PROGRAM, COMMANDS, words[1:]))


def test_the_docs_list_the_scenes_of_others_with_their_licence():
    _, imported = read_open()
    listed = (ROOT / "docs" / "benchmarks.md").read_text()
    sources = (ROOT / "docs" / "sources.md").read_text()
    for name, scene in imported.items():
        row = rf"^\| `{name}` \|.*\| {re.escape(scene.licence)} \| [0-9.]+ \| [0-9]+ \|$"
        assert re.search(row, listed, re.MULTILINE), name
        assert f"({scene.repository})" in sources


OTHERS = {
    "name": "house_of_others",
    "repository": "https://github.com/owner/houses",
    "commit": "0" * 40,
    "file": "worlds/house.world",
    "licence": "MIT",
}


def test_a_scene_of_others_that_is_missing_or_another_is_explained(tmp_path, monkeypatch):
    monkeypatch.setenv("ANM_MJ_SCENES", str(tmp_path))
    wanted = ImportedScene(**OTHERS, hash="0" * 64)
    with pytest.raises(SceneError, match=r"git checkout 0{40}\nanm-mj scene import worlds/house\.world"):
        find_imported(wanted)

    make_small_scene(tmp_path / "house_of_others")
    with pytest.raises(SceneError, match="the comparison's file says 000000000000"):
        find_imported(wanted)
    assert find_imported(ImportedScene(**OTHERS)).folder == tmp_path / "house_of_others"


def test_an_entry_of_a_scene_of_others_is_checked(tmp_path):
    file = tmp_path / "own.toml"
    file.write_text('scenes = ["x"]\npolicies = ["random"]\n[[imported]]\nname = "x"\nrepository = "ftp://x"\n')
    with pytest.raises(BenchError, match="repository, commit"):
        read_jobs(file)


def test_variants_stand_beside_the_policies_as_they_come():
    sweeps, generated = read_suite("variants")
    assert generated == read_suite("test")[1]

    def is_varied(sweep):
        return (sweep.preset, sweep.sensor, sweep.pose, sweep.settings) != ("default", ("exact",), ("true",), ())

    def runs(varied):
        each = [(one.policies, one.scenes, range(one.starts)) for one in sweeps if is_varied(one) == varied]
        return {run for axes in each for run in itertools.product(*axes)}

    # Those as they come are runs of suite test, which are published.
    def as_they_come(sweeps):
        each = [
            itertools.product(one.policies, one.scenes, range(one.starts), [(one.budget, one.views, one.maps)])
            for one in sweeps
            if not is_varied(one)
        ]
        return {run for run in itertools.chain(*each) if run[0] != "anm"}

    assert as_they_come(sweeps) < as_they_come(read_suite("test")[0])
    assert {sweep.budget for sweep in sweeps if is_varied(sweep)} == {"area"}

    # A map that only anm has is compared with the other policies.
    assert {policy for policy, _, _ in runs(varied=True)} == {"anm", "anm-s", "frontier", "gvg"}
    assert {run for run in runs(varied=True) if run[0] != "anm"} <= runs(varied=False)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["smoke", "tune", "test", "large", "people"])
def test_all_published_scenes_come_out_again(name, cache):
    _, generated = read_suite(name)
    for wanted in generated.values():
        provide(wanted)


def test_an_unknown_suite_is_named():
    with pytest.raises(BenchError, match="smoke"):
        suite_file("../smoke")


def test_no_seed_of_the_test_suite_appears_elsewhere():
    _, generated = read_suite("test")
    seeds = re.compile(rb"\b(" + b"|".join(str(scene.seed).encode() for scene in generated.values()) + rb")\b")
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split(
        "\n"
    )
    own = suite_file("test").relative_to(ROOT).as_posix()
    kept = [name for name in listed if name.endswith((".py", ".toml", ".md", ".sh", ".json")) and name != own]
    where = [name for name in kept if (ROOT / name).is_file() and seeds.search((ROOT / name).read_bytes())]
    assert where == [], "seeds of the suite test are for judging only"


def test_a_published_scene_comes_out_again(cache, tmp_path):
    _, generated = read_suite("smoke")
    wanted = generated["smoke_1"]
    scene = provide(wanted)
    before = (scene.folder / "scene.toml").stat().st_mtime_ns
    assert (provide(wanted).folder / "scene.toml").stat().st_mtime_ns == before

    file = tmp_path / "own.toml"
    entry = f'[[generated]]\nname = "smoke_1"\nrooms = {wanted.rooms}\nseed = {wanted.seed}\n'
    file.write_text('scenes = ["smoke_1"]\npolicies = ["random"]\nbudget = "area"\n' + entry)
    (job,) = read_jobs(file)
    assert job.steps == default_steps(scene, "area") >= BASE_STEPS + STEPS_PER_M2
    assert job.scene_hash == scene.hash == wanted.hash


def test_a_scene_that_comes_out_differently_is_refused(cache):
    with pytest.raises(SceneError, match="would not compare"):
        provide(GeneratedScene("tiny", rooms=1, seed=11, hash="0" * 64))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('[[generated]]\nname = "x"\nrooms = 0\nseed = 1\n', "rooms"),
        ('[[generated]]\nname = "../x"\nrooms = 1\nseed = 1\n', "name"),
        ('[[generated]]\nname = "x"\nrooms = 1\n', "seed"),
        ('[[generated]]\nname = "x"\nrooms = 1\nseed = 1\ncolour = "red"\n', "colour"),
        ('generated = "x"\n', "generated"),
    ],
)
def test_a_wrong_entry_is_named(text, says, tmp_path):
    file = tmp_path / "own.toml"
    file.write_text('scenes = ["x"]\npolicies = ["random"]\n' + text if "[[" in text else text + 'scenes = ["x"]\n')
    with pytest.raises(BenchError, match=says):
        read_jobs(file)


def test_a_wrong_budget_is_named(tmp_path):
    (tmp_path / "own.toml").write_text('scenes = ["home"]\npolicies = ["random"]\nbudget = "money"\n')
    with pytest.raises(BenchError, match="scene, area, rooms or both"):
        read_jobs(tmp_path / "own.toml")


def test_what_users_are_told_to_paste_is_quoted():
    wanted = {**OTHERS, "file": "a; rm -rf /", "options": "--up z $(id)", "repository": "https://x/`id`"}
    told = ImportedScene(**wanted).instructions
    assert "'a; rm -rf /'" in told
    assert "--up z '$(id)'" in told
    assert "'https://x/`id`'" in told
