import ast
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

import anm_mj
from anm_mj.errors import PlanError
from anm_mj.planning.policies import registry
from anm_mj.planning.policies.context import PolicyConfig, PolicyContext
from anm_mj.planning.policies.registry import (
    DEFAULT_POLICY,
    default_settings,
    make_policy,
    needs_truth,
    policies,
    policy_class,
)
from anm_mj.protocols import Policy
from anm_mj.types import Footprint

PACKAGE = Path(anm_mj.__file__).parent
OTHER_MEANINGS = {
    ("mapping/mapping_config.py", "anm"),  # A mapping preset.
    ("evaluation/oracle/tour_planner.py", "oracle"),  # A folder of the cache.
    ("planning/policies/anm_s/anm_s_config.py", "random"),  # A way to choose a target.
    ("planning/policies/anm_s/candidate_vertices.py", "random"),
    ("planning/policies/anm_s/anm_s_policy.py", "random"),
}
BODY = Footprint(0.18, 0.05, 1.35)


class Own:
    """A user's policy, with settings of its own."""

    def __init__(self, context):
        self.context = context

    def observe(self, observation): ...

    def plan(self, mapper, observation): ...

    def on_collision(self, pose, action): ...


class Unmakeable(Own):
    def __init__(self):
        pass


class Lacking:
    def plan(self, mapper, observation): ...


def test_no_policy_name_stands_outside_of_the_registry():
    found = {
        (str(path.relative_to(PACKAGE)), node.value)
        for path in PACKAGE.rglob("*.py")
        if path.name != "registry.py"
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value in policies()
    }
    assert found <= OTHER_MEANINGS


@pytest.mark.parametrize("name", policies())
def test_every_policy_has_settings_of_its_own_class(name):
    assert isinstance(default_settings(name), PolicyConfig)


@pytest.mark.parametrize("name", [name for name in policies() if not needs_truth(name)])
def test_every_policy_is_made_from_a_context(name):
    assert isinstance(make_policy(name, PolicyContext(BODY, default_settings(name))), Policy)


def test_the_default_policy_is_registered():
    assert DEFAULT_POLICY in policies()


def test_a_policy_that_needs_the_truth_says_so_when_it_is_not_told():
    (name,) = filter(needs_truth, policies())
    with pytest.raises(PlanError, match="true scene"):
        make_policy(name, PolicyContext(BODY, default_settings(name)))


def test_names_of_one_class_differ_by_their_defaults():
    assert policy_class("frontier-full") is policy_class("frontier")
    assert default_settings("frontier-full").range_m > default_settings("frontier").range_m


def test_a_class_of_the_users_own_needs_no_entry():
    name = f"{__name__}:Own"
    assert isinstance(default_settings(name), PolicyConfig)
    assert make_policy(name, PolicyContext(BODY, default_settings(name), seed=3)).context.seed == 3


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("greedy", "frontier-full"),
        ("no_such_module:Policy", "cannot be imported"),
        ("made/no_such_module.py:Policy", "cannot be imported .*; write no_such_module:Policy, with the file"),
        (f"{__name__}:Nothing", r"test_registry\.py\) has no class 'Nothing'"),
        (f"{__name__}:Lacking", "observe, on_collision"),
        (f"{__name__}:Unmakeable", "PolicyContext"),
    ],
)
def test_what_is_no_policy_is_refused_with_the_reason(name, said):
    with pytest.raises(PlanError, match=said):
        make_policy(name, PolicyContext(BODY, PolicyConfig()))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("import sys\nsys.exit(0)", "cannot be imported .SystemExit"),
        ("class P:\n observe = plan = on_collision = print\n def __init__(self, context): exit(0)", "SystemExit"),
        (
            "class P:\n observe = plan = on_collision = print\n class Config:\n  def __init__(self): raise KeyError",
            "its Config cannot be made",
        ),
    ],
)
def test_what_ends_the_program_is_a_reason_too(tmp_path, monkeypatch, text, said):
    module = f"ends_{abs(hash(text))}"
    (tmp_path / f"{module}.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(PlanError, match=said):
        make_policy(f"{module}:P", PolicyContext(BODY, default_settings(f"{module}:P")))


def test_a_goal_that_there_is_not_is_refused():
    with pytest.raises(PlanError, match=r"no goal 'coverag' \(did you mean coverage\?\); choose one of coverage"):
        anm_mj.make_policy("gvg", footprint=BODY, goal="coverag")


def test_a_policy_of_another_package_that_cannot_be_loaded_is_left_out(monkeypatch, caplog):
    """It must not keep anybody from the others."""
    points = [
        EntryPoint("gone", "no_such_module:ENTRY", registry.ENTRY_POINTS),
        EntryPoint("odd", "math:pi", registry.ENTRY_POINTS),
        EntryPoint("theirs", "anm_mj.evaluation.oracle.entry:ORACLE", registry.ENTRY_POINTS),
    ]
    monkeypatch.setattr(registry, "entry_points", lambda group: points)
    registry.policies.cache_clear()
    try:
        found = registry.policies()
    finally:
        registry.policies.cache_clear()
    assert "theirs" in found
    assert not {"gone", "odd"} & set(found)
    assert "'gone' is left out: no_such_module:ENTRY cannot be loaded" in caplog.text
    assert "'odd' is left out: math:pi is no PolicyEntry" in caplog.text
