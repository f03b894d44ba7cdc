import dataclasses
import hashlib
import importlib
import inspect
import json
import math
import re
import sys

import pytest

from anm_mj.bench.sweep import BenchError, read_jobs
from anm_mj.errors import AnmError, ConfigError, SceneError
from anm_mj.planning.policies.registry import policies, policy_class
from anm_mj.scene.folder import load_scene
from tests.robots import ROVER_XML
from tests.scene.small import make_small_scene


def jobs_of(tmp_path, text):
    file = tmp_path / "bench.toml"
    file.write_text(text)
    return read_jobs(file)


def test_runs_are_the_product_of_the_lists(tmp_path):
    jobs = jobs_of(
        tmp_path, 'scenes = ["home"]\npolicies = ["random", "gvg"]\nstarts = 3\nseeds = [0, 5]\nsteps = 40\n'
    )

    assert len(jobs) == 12
    assert {(job.policy, job.start, job.seed) for job in jobs} == {
        (policy, start, seed) for policy in ("random", "gvg") for start in range(3) for seed in (0, 5)
    }
    config = jobs[-1].config()
    start = load_scene("home").starts[2]
    assert config.start == (start.x_m, start.y_m, math.degrees(start.yaw_rad))
    assert (config.policy, config.seed, config.steps) == ("gvg", 5, 40)


def test_outer_keys_hold_for_all_sweeps(tmp_path):
    jobs = jobs_of(
        tmp_path,
        'scenes = ["home"]\nsteps = 30\n[[sweep]]\npolicies = ["gvg"]\nstarts = 2\n'
        '[[sweep]]\npolicies = ["random"]\npreset = "quick"\nsettings = ["planning.margin_m=0.06"]\n',
    )

    assert [(job.policy, job.start, job.preset) for job in jobs] == [
        ("gvg", 0, "default"),
        ("gvg", 1, "default"),
        ("random", 0, "quick"),
    ]
    assert jobs[2].config().planning.margin_m == 0.06


def test_default_steps_are_the_budget_of_the_scene(tmp_path):
    (job,) = jobs_of(tmp_path, 'scenes = ["home"]\npolicies = ["gvg"]\n')
    scene = load_scene("home")

    assert job.steps == (scene.budget_steps or 2000)


def test_names_are_unique_to_the_content(tmp_path):
    (job,) = jobs_of(tmp_path, 'scenes = ["home"]\npolicies = ["gvg"]\n')
    others = [
        dataclasses.replace(job, steps=7),
        dataclasses.replace(job, scene_hash="0"),
        dataclasses.replace(job, preset="quick"),
        dataclasses.replace(job, settings=("planning.margin_m=0.06",)),
        dataclasses.replace(job, start_pose=(0.0, 0.0, 0.0)),
    ]

    assert len({other.name for other in (job, *others)}) == 6
    assert dataclasses.replace(job, scene="elsewhere/home").name == job.name


def test_views_are_a_choice_and_those_of_before_keep_their_names(tmp_path):
    text = 'scenes = ["home"]\npolicies = ["gvg"]\n'
    (with_views,), (without,) = jobs_of(tmp_path, text), jobs_of(tmp_path, text + "views = false\n")
    assert with_views.views
    assert not without.views
    assert with_views.name != without.name
    assert with_views.name == dataclasses.replace(without, views=True).name


def test_maps_that_nobody_asks_are_a_choice(tmp_path):
    text = 'scenes = ["home"]\npolicies = ["gvg", "frontier"]\n'
    always, seldom = jobs_of(tmp_path, text), jobs_of(tmp_path, text + "maps = false\n")
    assert [job.trains for job in always] == [True, True]
    assert [job.trains for job in seldom] == [True, False]
    schedules = [job.config().mapping.schedule for job in seldom]
    assert [(each.first_iterations > 0, each.iterations > 0, each.final_iterations > 0) for each in schedules] == [
        (True, True, True),
        (False, False, False),
    ]
    assert seldom[1].config().mapping.geometry == "occupancy"
    assert not {job.name for job in always} & {job.name for job in seldom}
    assert always[1].name == dataclasses.replace(seldom[1], maps=True).name
    # What such a sensor shows blocks other paths without a field.
    assert dataclasses.replace(seldom[1], sensor="d435i").trains
    assert dataclasses.replace(seldom[1], pose="odometry").trains
    assert dataclasses.replace(seldom[1], settings=("sensor.max_range_m=3",)).trains


def test_policies_that_ask_no_map_are_those_that_drop_it_unread():
    for name, entry in policies().items():
        source = inspect.getsource(policy_class(name).plan)
        assert entry.asks_map == ("del mapper" not in source), name


def test_robot_drive_pose_and_sensor_vary(tmp_path):
    (tmp_path / "rover.xml").write_text(ROVER_XML.read_text())
    text = 'scenes = ["home"]\npolicies = ["gvg"]\ndrive = "physics"\npose = ["true", "odometry"]\n'
    jobs = jobs_of(tmp_path, text + 'sensor = ["exact", "d435i"]\nrobot = ["diff_drive", "rover.xml"]\n')
    assert len({job.name for job in jobs}) == len(jobs) == 8
    assert {job.robot for job in jobs} == {"diff_drive", str(tmp_path / "rover.xml")}
    job = jobs[-1]
    config = job.config()
    assert (config.robot, config.drive, config.pose) == (job.robot, "physics", "odometry")
    assert config.sensor.name == "d435i"
    assert job.facts["robot"] == "rover.xml"
    assert {bool(job.robot_hash) for job in jobs if job.robot != "diff_drive"} == {True}
    assert {job.robot_hash for job in jobs if job.robot == "diff_drive"} == {""}


def test_a_policy_that_was_edited_is_another(tmp_path, monkeypatch):
    text = "class Mine:\n    observe = plan = on_collision = None.__init__\n"
    monkeypatch.syspath_prepend(tmp_path)
    found = []
    for more in ("", "", "    speed = 2\n"):
        (tmp_path / "mine_to_edit.py").write_text(text + more)
        monkeypatch.delitem(sys.modules, "mine_to_edit", raising=False)
        importlib.invalidate_caches()
        (mine, builtin) = jobs_of(tmp_path, 'scenes = ["home"]\npolicies = ["mine_to_edit:Mine", "gvg"]\n')
        found.append(mine)
        assert not builtin.policy_hash
    assert found[0].name == found[1].name != found[2].name
    assert found[0].facts != found[2].facts


def test_a_robot_that_was_edited_is_another(tmp_path):
    text, other = ROVER_XML.read_text(), tmp_path / "other"
    file = 'scenes = ["home"]\npolicies = ["gvg"]\nrobot = ["rover.xml"]\n'
    (tmp_path / "rover.xml").write_text(text)
    (before,), (again,) = jobs_of(tmp_path, file), jobs_of(tmp_path, file)
    (tmp_path / "rover.xml").write_text(text.replace('fovy="60"', 'fovy="70"'))
    (after,) = jobs_of(tmp_path, file)
    assert before.name == again.name != after.name
    other.mkdir()
    (other / "rover.xml").write_text(text)
    with pytest.raises(BenchError, match=r"would share the names of their results; rename one file"):
        jobs_of(tmp_path, file.replace('["rover.xml"]', '["rover.xml", "other/rover.xml"]'))


def test_names_of_former_comparisons_stay(tmp_path):
    (job,) = jobs_of(tmp_path, 'scenes = ["home"]\npolicies = ["gvg"]\nsteps = 9\n')
    known = dataclasses.replace(job, scene_hash="0", start_pose=(0.0, 0.0, 0.0))
    former = ("scene_name", "scene_hash", "policy", "start", "start_pose", "seed", "steps", "preset", "settings")
    facts = {name: value for name, value in dataclasses.asdict(known).items() if name in former}
    assert known.name.endswith(hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:8])


@pytest.mark.parametrize(
    ("text", "error", "match"),
    [
        ('scenes = ["home"]\npolicies = ["gvg"]\ndrive = "magic"\n', AnmError, "no drive 'magic'"),
        ('scenes = ["home"]\npolicies = ["gvg"]\nrobot = ["no.xml"]\n', AnmError, r"no robot file no\.xml"),
        ('scenes = ["home"]\npolicies = ["gvg"]\nsensor = []\n', BenchError, "sensor is empty"),
        ('scenes = ["home"]\npolicies = ["gvg"]\npose = 3\n', BenchError, r"pose is 3, .*expected array, got int"),
        ('scenes = ["home"]\npolicies = ["gvg"]\npose = [3]\n', BenchError, r"pose is \[3\], .*expected str, got int"),
        ("", BenchError, "scenes is missing"),
        ("sweep = []", BenchError, "sweep is empty"),
        ('scenes = ["home"]\n', BenchError, "policies is missing"),
        ('scenes = ["home"]\npolicies = ["gvg"]\nstart = 2\n', BenchError, "there is no 'start'"),
        ('scenes = ["home"]\npolices = ["gvg"]\n', BenchError, r"no 'polices' \(did you mean policies\?\)"),
        ('scenes = ["home"]\npolicies = ["gvg"]\n[[sweeps]]\n', BenchError, r"no 'sweeps' \(did you mean sweep\?\)"),
        ('scenes = "home"\npolicies = ["gvg"]\n', BenchError, "scenes is 'home', .*expected array, got str"),
        ('scenes = ["home"]\npolicies = ["gvg"]\nstarts = 99\n', BenchError, "start poses; give 1"),
        ('scenes = ["home"]\npolicies = ["gvg"]\npreset = "best"\n', AnmError, "no preset 'best'"),
        ('scenes = ["home"]\npolicies = ["best"]\n', AnmError, "Unknown policy 'best'"),
        ('scenes = ["no_such"]\npolicies = ["gvg"]\n', SceneError, "no_such"),
        (f'scenes = ["{"x" * 5000}"]\npolicies = ["gvg"]\n', SceneError, "no scene"),
        (f'scenes = ["home"]\npolicies = ["gvg"]\nrobot = ["{"x" * 5000}.xml"]\n', AnmError, "no robot file"),
        ("scenes = [", BenchError, "cannot be read"),
        ("sweep = 3", BenchError, "list of tables"),
    ],
)
def test_bad_files_are_refused(tmp_path, text, error, match):
    with pytest.raises(error, match=match):
        jobs_of(tmp_path, text)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(BenchError, match=r"There is no file .*nowhere\.toml;"):
        read_jobs(tmp_path / "nowhere.toml")


@pytest.mark.parametrize("names", [("a/b", "a-b"), ("a", "a")])
def test_scenes_whose_results_would_share_a_name_are_refused(tmp_path, names):
    for folder, name in zip(("one", "two"), names, strict=True):
        toml = make_small_scene(tmp_path / folder).folder / "scene.toml"
        text = re.sub(r"(?m)^name = .*$", f'name = "{name}"', toml.read_text())
        toml.write_text(re.sub(r"(?m)^hash = .*$", f'hash = "{folder}"', text))
    with pytest.raises(BenchError, match=f"'{names[1]}' .*and '{names[0]}' .*would share the names"):
        jobs_of(tmp_path, 'scenes = ["one", "two"]\npolicies = ["random"]\nstarts = 1\n')
    assert len(jobs_of(tmp_path, 'scenes = ["one", "one"]\npolicies = ["random"]\nstarts = 1\n')) == 1


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("seeds = []", "seeds is empty"),
        ("steps = true", "steps is True, .*expected int"),
        ("starts = true", "starts is True"),
    ],
)
def test_a_comparison_of_nothing_is_refused(tmp_path, line, said):
    with pytest.raises(BenchError, match=said):
        jobs_of(tmp_path, f'scenes = ["home"]\npolicies = ["random"]\n{line}\n')


def test_too_many_runs_are_refused_before_they_are_listed(tmp_path):
    path = tmp_path / "many.toml"
    path.write_text(f'scenes = ["room"]\npolicies = ["random"]\nsteps = 5\nseeds = {list(range(10_001))}\n')
    with pytest.raises(BenchError, match="10001 runs, but they end at 10000; set ANM_MJ_MAX_RUNS"):
        read_jobs(path)


def test_a_reality_stands_for_conditions_and_settings_and_what_is_given_goes_before_it(tmp_path):
    text = 'scenes = ["home"]\npolicies = ["gvg"]\nreality = ["ideal", "real"]\n'
    ideal, real = jobs_of(tmp_path, text)
    (plain,) = jobs_of(tmp_path, 'scenes = ["home"]\npolicies = ["gvg"]\n')
    assert ideal == plain
    assert ideal.name == plain.name
    assert (real.drive, real.pose, real.sensor, real.reality) == ("physics", "slam", "d435i", "real")
    assert (real.variant, ideal.variant) == ("gvg (real)", "gvg")
    config = real.config()
    assert (config.reality, config.people.number, config.model.wheel_noise) == ("real", 3, 0.02)
    assert config.mapping.moving.detect
    one = 'reality = "real"\ndrive = "kinematic"\nsettings = ["people.number=0"]\n'
    (other,) = jobs_of(tmp_path, 'scenes = ["home"]\npolicies = ["gvg"]\n' + one)
    assert other.variant == "gvg (real kinematic people.number=0)"
    config = other.config()
    assert (config.drive, config.people.number, config.sensor.name) == ("kinematic", 0, "d435i")
    assert not config.mapping.moving.detect
    with pytest.raises(ConfigError, match=r"no reality 'reel' \(did you mean real\?\)"):
        jobs_of(tmp_path, 'scenes = ["home"]\npolicies = ["gvg"]\nreality = "reel"\n')
    with pytest.raises(BenchError, match="reality is 3"):
        jobs_of(tmp_path, 'scenes = ["home"]\npolicies = ["gvg"]\nreality = 3\n')


def test_a_policy_of_the_users_own_is_tried_in_the_real_world_too(tmp_path):
    file = tmp_path / "bench.toml"
    file.write_text('scenes = ["home"]\npolicies = ["gvg"]\nreality = ["ideal", "real"]\n')
    assert [job.variant for job in read_jobs(file, ["random"])] == ["gvg", "random", "gvg (real)", "random (real)"]
