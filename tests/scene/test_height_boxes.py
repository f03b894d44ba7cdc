"""Collision boxes of robots that are lower or higher than the one that scenes are made for."""

import warnings

import mujoco
import numpy as np
import pytest

from anm_mj.scene.build import build_model
from anm_mj.scene.importing.import_scene import import_scene

ROBOT = """<mujoco><option integrator="RK4" cone="pyramidal"/><worldbody><body><freejoint/><geom size="0.1"/></body>
</worldbody></mujoco>"""


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    """A table top at 0.7 m on a leg, and a lamp at 1.6 m, on a floor of 8 x 8 m."""
    folder = tmp_path_factory.mktemp("table")
    (folder / "a.xml").write_text(
        '<mujoco><worldbody><geom type="plane" size="4 4 1"/><geom type="box" size="0.5 0.5 0.02" pos="2 0 0.7"/>'
        '<geom type="box" size="0.03 0.03 0.34" pos="2 0 0.34"/><geom type="box" size="0.2 0.2 0.1" pos="-2 0 1.6"/>'
        "</worldbody></mujoco>"
    )
    return import_scene(folder / "a.xml", folder / "out")


def _meets(model, x, y):
    """Whether a collision geom stands at a place, seen from above at 1.9 m."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    geom = np.zeros(1, dtype=np.int32)
    group = np.array([0, 0, 0, 1, 0, 0], np.uint8)
    hit = mujoco.mj_ray(model, data, np.array([x, y, 1.9]), np.array([0.0, 0.0, -1.0]), group, 1, -1, geom)
    return hit < 1.85


@pytest.mark.parametrize(
    ("top_m", "below_table", "leg", "below_lamp"),
    [(None, True, True, False), (1.35, True, True, False), (0.2, False, True, False), (1.7, True, True, True)],
)
def test_a_robot_meets_what_is_as_high_as_it_is(table, top_m, below_table, leg, below_lamp):
    model = build_model(table, mujoco.MjSpec.from_string(ROBOT), top_m=top_m)
    assert _meets(model, 2.3, 0.3) == below_table
    assert _meets(model, 2.0, 0.0) == leg
    assert _meets(model, -2.0, 0.0) == below_lamp


def test_options_of_the_robot_cause_no_warning(table):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model = build_model(table, mujoco.MjSpec.from_string(ROBOT))
    assert model.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST
