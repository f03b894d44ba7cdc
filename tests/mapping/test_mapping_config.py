import json
import subprocess
import sys
from dataclasses import asdict

import pytest

from anm_mj.errors import MapError
from anm_mj.mapping.mapping_config import (
    MAPPING_PRESETS,
    FieldConfig,
    LossConfig,
    OptimizerConfig,
    SamplingConfig,
    ScheduleConfig,
    UncertaintyConfig,
    config_from_dict,
)


@pytest.mark.parametrize("name", sorted(MAPPING_PRESETS))
def test_presets_survive_json(name):
    config = MAPPING_PRESETS[name]()
    assert config_from_dict(json.loads(json.dumps(asdict(config)))) == config


def test_paper_preset():
    paper = MAPPING_PRESETS["paper"]()
    assert (paper.sampling.free_samples, paper.sampling.near_samples, paper.sampling.far_m) == (32, 11, 4.0)
    assert (paper.schedule.num_rays, paper.schedule.iterations, paper.schedule.train_every) == (2048, 10, 5)
    assert (paper.loss.rgb, paper.loss.depth, paper.loss.sdf, paper.loss.free_space) == (5.0, 0.1, 1000.0, 10.0)
    assert (paper.loss.smoothness, paper.loss.smoothness_points) == (1e-5, 31)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: FieldConfig(num_levels=0), "num_levels is 0"),
        (lambda: FieldConfig(finest_cell_m=1.0), "finest_cell_m is 1.0"),
        (lambda: FieldConfig(largest_log2_table_size=23), "largest_log2_table_size is 23"),
        (lambda: FieldConfig(entries_per_m3=0.0), r"entries_per_m3 is 0\.0"),
        (lambda: SamplingConfig(near_samples=0), "near_samples is 0"),
        (lambda: LossConfig(sdf=-1.0), "sdf is -1.0"),
        (lambda: OptimizerConfig(beta1=1.0), "beta1 is 1.0"),
        (lambda: ScheduleConfig(pixel_share=0.0), "pixel_share is 0.0"),
        (lambda: ScheduleConfig(density_exponent=1.5), "density_exponent is 1.5"),
        (lambda: UncertaintyConfig(num_passes=1), "num_passes is 1"),
    ],
)
def test_values_out_of_range(make, message):
    with pytest.raises(MapError, match=message):
        make()


def test_unknown_field_is_refused():
    with pytest.raises(MapError, match="does not know"):
        config_from_dict({"field": {"levels": 3}})


def test_config_does_not_import_torch():
    code = "import sys, anm_mj.mapping.mapping_config; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
