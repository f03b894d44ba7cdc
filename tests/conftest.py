"""Runs before any test module: checks array shapes in calls and picks the GL back-end that mujoco will use."""

import functools
import os
from pathlib import Path

import hypothesis
import pytest
from jaxtyping import install_import_hook

import tests.typechecker  # The hook finds it by name, as an attribute of tests.

# Each worker has a core to itself, where torch and BLAS would start a thread per core of the machine. They read
# these once, when they are loaded; processes that tests start inherit them.
if "PYTEST_XDIST_WORKER" in os.environ:
    for _name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(_name, "1")

# Only modules imported after this line are checked, so it stands before the first import of anm_mj.
if os.environ.get("CHECKED_CALLS") == "some":
    tests.typechecker.check_some_calls()
install_import_hook("anm_mj", "tests.typechecker.check")

from anm_mj.errors import RenderError  # noqa: E402
from anm_mj.sim.gl import select_backend  # noqa: E402
from tests.public_scenes import PUBLIC_SCENES  # noqa: E402

try:
    # Sets MUJOCO_GL in the controlling process too, from which pytest-xdist's workers inherit it.
    if select_backend().attempts and select_backend().name == "off":
        pytest.exit("No GL back-end works here, which many tests need; anm-mj doctor says why.", returncode=1)
except RenderError as err:
    pytest.exit(str(err), returncode=1)

# The same examples in every run, so that a failure is one of the code; and no limit on how long one takes, because
# shape checks and a busy machine make times meaningless.
hypothesis.settings.register_profile("repeatable", derandomize=True, deadline=None)
hypothesis.settings.load_profile("repeatable")


def pytest_runtest_setup():
    tests.typechecker.next_test()


@pytest.fixture(scope="module")
def quick_results():
    """Runs in this process end with a tenth of the samples on the mesh and on the true surface, and with small
    pictures: to judge and to draw a short run as a long one takes longer than the run.
    """
    from anm_mj.evaluation import run_evaluation
    from anm_mj.ground_truth.ground_truth import GroundTruth
    from anm_mj.viz import figure_file

    judge, write, sample = run_evaluation.mesh_quality, figure_file.write_figure, GroundTruth.sample

    def sample_less(vertices, faces, num_samples):
        return sample(vertices, faces, num_samples // 10)

    def write_small(figure, path, kind):
        figure.set_dpi(20)
        write(figure, path, kind)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run_evaluation, "mesh_quality", functools.partial(judge, num_samples=20_000))
        patch.setattr(figure_file, "write_figure", write_small)
        patch.setattr(GroundTruth, "sample", sample_less)
        yield


@pytest.fixture(scope="session")
def public_scenes() -> Path:
    """The folder of scenes of others."""
    if not PUBLIC_SCENES.is_dir():
        pytest.skip("ANM_MJ_PUBLIC_SCENES names no folder of public scenes")
    return PUBLIC_SCENES
