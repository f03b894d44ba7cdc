import json

import pytest

from anm_mj.bench.comparison import _stages
from anm_mj.bench.executor import RESULT
from anm_mj.bench.job import Job
from anm_mj.bench.oracle_run import with_warm_start
from anm_mj.bench.sweep import read_jobs
from anm_mj.errors import BenchError


def test_an_oracle_makes_a_tour_for_each_budget_and_measure(tmp_path):
    file = tmp_path / "own.toml"
    file.write_text('scenes = ["home"]\npolicies = ["oracle", "gvg"]\nbudget = "both"\n')
    jobs = read_jobs(file)
    tours = [job for job in jobs if job.policy == "oracle"]
    assert len(tours) == 4
    assert len({job.name for job in jobs}) == len(jobs) == 5
    assert {(job.cuts[0][0], job.settings[-1]) for job in tours} == {
        (by, f"policy.measure={measure}") for by in ("area", "rooms") for measure in ("auc", "end")
    }
    assert all(job.cuts == ((job.cuts[0][0], job.steps),) for job in tours)


def test_an_oracle_learns_from_the_runs_of_its_own_start(tmp_path):
    def job(policy, start=0, **others):
        place = (float(start), 0.0, 0.0)
        return Job("room", "room", "0" * 64, policy, start, place, 0, 50, "default", (), **others)

    jobs = [job("gvg"), job("frontier"), job("gvg", start=1), job("gvg", pose="odometry"), job("oracle")]
    for one in jobs:
        (tmp_path / one.name).mkdir()
        (tmp_path / one.name / RESULT).write_text(json.dumps(one.facts))

    config = with_warm_start(jobs[-1].config(), jobs[-1], tmp_path)

    assert config.policy_settings.warm_start.split(":") == sorted(str(tmp_path / one.name) for one in jobs[:2])


def test_a_tour_begins_from_those_of_the_measures_before_it(tmp_path):
    file = tmp_path / "own.toml"
    file.write_text('scenes = ["home"]\npolicies = ["oracle", "gvg"]\nbudget = "both"\n')
    stages = list(_stages(read_jobs(file)))
    assert [[job.policy for job in stage] for stage in stages] == [["gvg"], ["oracle"] * 2, ["oracle"] * 2]
    made = [job for stage in stages for job in stage]
    for one in made:
        (tmp_path / one.name).mkdir()
        (tmp_path / one.name / RESULT).write_text(json.dumps(one.facts))
    begins = [with_warm_start(job.config(), job, tmp_path).policy_settings.warm_start for job in made[1:]]
    known = [set(text.split(":")) for text in begins]
    before = [{str(tmp_path / one.name) for one in made[:count]} for count in (1, 3)]
    # That all runs are there already, as of a comparison that is repeated in part, changes nothing.
    assert known == [before[0], before[0], before[1], before[1]]


def test_a_damaged_run_beside_the_oracles_is_named(tmp_path):
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / RESULT).write_text("{}")
    job = Job("room", "room", "0" * 64, "oracle", 0, (0.0, 0.0, 0.0), 0, 50)
    with pytest.raises(BenchError, match=r"broken is damaged .*; delete it"):
        with_warm_start(job.config(), job, tmp_path)
