import json
import re
from dataclasses import asdict

import pytest

from anm_mj.config import OPTIONS, ConfigError, RunConfig, make_config, read_config
from anm_mj.errors import AnmError, PlanError
from anm_mj.planning.policies.registry import policies
from anm_mj.robot.robot_presets import preset_config


def config_with(*settings, preset="default", **options):
    return make_config(preset, list(settings), scene="home", **options)


def written(config):
    """The content of ``config.json``."""
    return json.loads(json.dumps(asdict(config)))


def test_settings_reach_the_configuration():
    config = config_with("planning.margin_m=0.06", "mapping.schedule.iterations=3", "policy.tour_depth=6")
    assert config.planning.margin_m == 0.06
    assert config.mapping.schedule.iterations == 3
    assert config.policy_settings.tour_depth == 6


def test_settings_leave_the_rest_of_the_preset_alone():
    config = config_with("mapping.schedule.iterations=3", preset="quick")
    assert config.mapping.field == config_with(preset="quick").mapping.field


@pytest.mark.parametrize("text", ["false", "False", "FALSE"])
def test_booleans_are_read_in_any_case(text):
    config = config_with(f"policy.visibility_guidance={text}", policy="anm-s")
    assert config.policy_settings.visibility_guidance is False


def test_settings_whose_limits_depend_on_one_another_may_come_in_any_order():
    config = config_with("mapping.occupancy.hit=100", "mapping.occupancy.limit=120")
    assert (config.mapping.occupancy.hit, config.mapping.occupancy.limit) == (100, 120)


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("planning.margin=0.1", "did you mean planning.margin_m"),
        ("tour_depht=3", "did you mean policy.tour_depth"),
        ("nosuch=1", "docs/reference.md and config.json of any run list all"),
        ("margin_m=0.1", "did you mean planning.margin_m"),
        ("planing.margin_m=0.1", "did you mean planning.margin_m?"),
        ("planning.xyz=1", "there are planning.margin_m, planning.sdf"),
        ("planning=1", "no such setting"),
        ("policy_settings=1", "no such setting"),
        ("planning.margin_m.x=1", "no such setting"),
        ("policy.bootstrap_turns=all", "not of type int"),
        ("policy=random", "use --policy random"),
        ("scene=office", "name the scene first"),
        ("sensor=d435i", "use --sensor d435i"),
        ("sensor.name=d435i", "use --sensor d435i"),
    ],
)
def test_a_wrong_setting_is_refused_with_what_would_be_right(setting, said):
    with pytest.raises(ConfigError, match=re.escape(said)):
        config_with(setting)


def test_a_value_beyond_the_limits_is_refused():
    with pytest.raises(PlanError, match=r"policy\.max_candidates is 0; it must be a number above zero"):
        config_with("policy.max_candidates=0")


@pytest.mark.parametrize("setting", ["planning.margin_m=1e181", "planning.start_radius_m=1e181"])
def test_a_distance_that_no_building_has_is_refused(setting):
    with pytest.raises(PlanError, match=r"1e[+]181"):
        config_with(setting)


def test_a_policy_brings_the_mapping_preset_that_it_needs():
    assert config_with(policy="anm").mapping.engine == "mlp"
    with pytest.raises(ConfigError, match="own kind"):
        config_with(preset="quick", policy="anm")


def test_a_policy_brings_the_uncertainty_that_it_needs_unless_told_otherwise():
    assert config_with(policy="anm-s").mapping.uncertainty == config_with(preset="paper").mapping.uncertainty
    assert config_with().mapping.uncertainty != config_with(preset="paper").mapping.uncertainty
    told = config_with("mapping.uncertainty.method=closed_form", policy="anm-s")
    assert told.mapping.uncertainty.method == "closed_form"


@pytest.mark.parametrize("policy", ["gvg", "anm-s", "anm", "random"])
def test_a_configuration_is_read_back_as_it_was_written(policy):
    config = config_with("planning.margin_m=0.06", policy=policy, start=(1.0, 2.0, 90.0), steps=7, image_px=64)
    assert read_config(written(config)) == config


def test_a_stored_configuration_without_a_scene_is_refused():
    values = written(config_with())
    del values["scene"]
    with pytest.raises(ConfigError, match="names no scene"):
        read_config(values)


def test_a_stored_setting_that_is_not_known_is_left_out():
    stored = written(config_with(seed=4))
    stored["planning"] |= {"number_of_thumbs": 2}
    assert read_config(stored) == config_with(seed=4)


def test_a_setting_that_moved_to_another_group_keeps_its_name():
    moved = config_with("mapping.geometry=occupancy")
    assert config_with("planning.geometry=occupancy") == moved != config_with()
    stored = written(moved)
    stored["planning"]["geometry"] = stored["mapping"].pop("geometry")
    assert read_config(stored) == moved


def test_a_named_robot_brings_its_settings():
    assert RunConfig("home", robot="stretch3").model == preset_config("stretch3") != RunConfig("home").model


def test_the_policys_settings_are_its_defaults_where_none_are_given():
    assert RunConfig("home").policy_settings == config_with().policy_settings


def _numbers(values, prefix=""):
    """Dotted names of all numbers in nested dictionaries, and whether they are several."""
    for name, value in values.items():
        several = isinstance(value, tuple)
        if isinstance(value, dict):
            yield from _numbers(value, f"{'policy' if name == 'policy_settings' else prefix + name}.")
        elif isinstance(value[0] if several and value else value, int | float) and not isinstance(value, bool):
            yield prefix + name, len(value) if several else 0


@pytest.mark.parametrize("policy", policies())
def test_every_number_has_a_largest_value(policy):
    """A setting of 10^12 metres, rays or megabytes would take all the memory or never end."""
    for name, count in _numbers(asdict(make_config("default", [], scene="flat", policy=policy))):
        if name not in OPTIONS:
            value = f"({'1000000000000, ' * count})" if count else "1000000000000"
            with pytest.raises(AnmError, match=r"1e\+12|1000000000000"):
                make_config("default", [f"{name}={value}"], scene="flat", policy=policy)
