import pytest

from anm_mj.errors import PlanError
from anm_mj.planning.policies.anm_s.anm_s_config import AnmSConfig


def test_an_unknown_way_of_visiting_is_refused():
    with pytest.raises(PlanError, match="sight"):
        AnmSConfig(visited_by="hearsay")


def test_an_unknown_way_to_choose_is_refused():
    with pytest.raises(PlanError, match="hierarchical"):
        AnmSConfig(target="nearest")
