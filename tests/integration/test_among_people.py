"""Whole runs among people: nobody is touched, no run ends early, the map keeps nobody."""

import json
import math
from pathlib import Path

import pytest
from PIL import Image

from anm_mj.bench.job import UNTRAINED
from anm_mj.config import make_config
from anm_mj.replay.film import film_frames
from anm_mj.replay.timeline import read_timeline
from anm_mj.run import run
from anm_mj.types import StopReason

QUICK = ["image_px=128", "mapping.schedule.first_iterations=50", "mapping.schedule.final_iterations=0"]
SEES_PEOPLE_STEP = 30
"""The robot has turned around by then."""


@pytest.mark.slow
@pytest.mark.parametrize(
    "people",
    [
        ["people.number=4"],
        ["people.number=1", "people.blocked_s=60"],
        ["people.number=2", "people.followers=1"],
        ["people.number=1", "people.chair_pushed_s=20"],
    ],
    ids=["crowd", "doorway", "follower", "pushed"],
)
def test_a_run_among_people_goes_on_and_touches_nobody(tmp_path, people, request):
    """Each leaves a picture of when somebody was nearest, ``build/people/<name>.png``."""
    config = make_config("default", [*QUICK, *people], scene="home", steps=150, goal="coverage")

    folder, metrics = run(config, out=tmp_path / "run")

    assert metrics.stop_reason == StopReason.BUDGET
    assert metrics.steps == 150
    assert metrics.people_contacts == 0
    assert metrics.people_nearest_m is not None
    assert metrics.people_nearest_m > -0.01
    assert metrics.ghost_percent is not None
    assert metrics.ghost_percent < 1.0
    lines = [json.loads(line) for line in folder.frames.read_text().splitlines()]
    assert all(len(line["people"]) == config.people.number for line in lines)
    apart_m = [min(math.dist(one[:2], (line["x_m"], line["y_m"])) for one in line["people"]) for line in lines]
    step = apart_m.index(min(apart_m[SEES_PEOPLE_STEP:]))
    pictures = Path(__file__).parents[2] / "build/people"
    pictures.mkdir(parents=True, exist_ok=True)
    _, picture, *_ = film_frames(read_timeline(folder.path), every=step)
    Image.fromarray(picture).save(pictures / f"{request.node.callspec.id}.png")


@pytest.mark.slow
def test_a_run_among_people_that_is_resumed_goes_on_alike(tmp_path):
    from anm_mj.events import On, Stepped
    from anm_mj.resume import resume

    settings = [
        *QUICK,
        "people.number=3",
        "people.vacuums=1",
        "people.chair_pushed_s=5",
        "checkpoint.every_steps=10",
        "checkpoint.loop_share=1.0",
    ]
    config = make_config("default", settings, scene="home", steps=40, goal="coverage")
    whole, _ = run(config, out=tmp_path / "whole")
    cut, _ = run(config, out=tmp_path / "cut", observers=[On(Stepped, lambda event: event.step == 25)])
    again, _ = resume(cut.path)

    def steps(folder):
        lines = [json.loads(line) for line in folder.steps.read_text().splitlines()]
        return [{key: value for key, value in line.items() if key != "ms"} for line in lines]

    assert steps(again) == steps(whole)
    assert again.frames.read_text() == whole.frames.read_text()


@pytest.mark.slow
def test_the_robot_drives_into_no_vacuum_robot_that_it_lost_sight_of(tmp_path):
    settings = ["image_px=128", *UNTRAINED, "people.vacuums=6", "people.chair_pushed_s=40"]
    config = make_config("default", settings, scene="home", steps=250, goal="coverage")

    _, metrics = run(config, out=tmp_path / "run")

    assert metrics.steps == 250
    assert metrics.people_contacts == 0
