"""The oracle among the policies: an entry point of ``pyproject.toml``, because it knows what no robot knows."""

from anm_mj.planning.policies.registry import PolicyEntry

ORACLE = PolicyEntry(
    "anm_mj.evaluation.oracle.oracle_policy:Oracle", "knows the scene", needs_truth=True, asks_map=False
)
