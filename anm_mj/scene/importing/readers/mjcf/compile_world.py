"""Compiles a MuJoCo world and brings it to the state that is imported."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import mujoco
import numpy as np

from anm_mj.errors import SceneError
from anm_mj.mjcf.read_mjcf import TIMESTEPS_S, OutsideError, quiet_mujoco, read_spec, root_tag
from anm_mj.utils.file_limits import limit

_SETTLE_S = 10.0
"""Bodies that still move after this time are taken as they are [s]."""
MAX_SETTLE_WORK = limit("ANM_MJ_MAX_SETTLE_WORK", 30_000_000)
"""Most work of settling a world, all steps together, in about a third of a microsecond."""
_REST = 0.01
"""Speeds [m/s, rad/s] below which everything counts as at rest."""


def compiled(src: Path, folders: Sequence[Path] = ()) -> mujoco.MjModel:
    """The model in a file; files that it names may lie in its own folder, those above, and ``folders``. Raises
    SceneError if the file is no MJCF, it or what it includes is missing or damaged, or it names files from elsewhere.
    """
    if not src.is_file():
        raise SceneError(f"{src} is no file: give the MJCF file of a world.")
    tag = root_tag(src)
    if not tag:
        raise SceneError(f"{src} is no XML file: give the MJCF file of a world.")
    if tag not in ("mujoco", "mujocoinclude", "robot"):
        raise SceneError(f"{src} is no MuJoCo model: it begins with <{tag}>, not <mujoco>.")
    try:
        spec = read_spec(src, others=folders, option="--model-path")
        # What does not collide is what a camera sees, too.
        spec.compiler.discardvisual = False
        with quiet_mujoco():
            return spec.compile()
    except OutsideError as err:
        raise SceneError(f"{src} is not read: {err}.") from err
    except (ValueError, RuntimeError, OSError, mujoco.FatalError) as err:
        said = " ".join(str(err).split()).rstrip(".")
        raise SceneError(
            f"MuJoCo cannot compile {src} ({said}): repair it until `python -m mujoco.viewer --mjcf={src.name}` opens "
            "it."
        ) from err


def initial_state(model: mujoco.MjModel, settle: bool) -> mujoco.MjData:
    """The model at its first key frame, or else as it is written; dropped until everything rests if asked. Raises
    SceneError if the simulation diverges or needs more memory than the file gives it, or a geom is nowhere.
    """
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    if settle and model.nv:
        _settle(model, data)
    # Poses only: contacts of thousands of geoms may need more memory than the file gives.
    mujoco.mj_kinematics(model, data)
    lost = np.flatnonzero(~(np.isfinite(data.geom_xpos).all(axis=1) & np.isfinite(data.geom_xmat).all(axis=1)))
    if len(lost):
        geom = int(lost[0])
        named = model.geom(geom).name or f"of the body {model.body(int(model.geom_bodyid[geom])).name!r}"
        raise SceneError(f"The place of the geom {named} is no number: repair the file.")
    return data


def _settle(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    kinds = mujoco.mjtWarning
    divergences = (kinds.mjWARN_BADQPOS, kinds.mjWARN_BADQVEL, kinds.mjWARN_BADQACC)
    shortest_s, longest_s = TIMESTEPS_S
    if not shortest_s <= model.opt.timestep <= longest_s:
        raise SceneError(
            f"The world has a timestep of {model.opt.timestep:g} s: give one from {shortest_s:g} to {longest_s:g} s by "
            "<option timestep=.../>, or import it without --settle."
        )
    work = 0
    while data.time < _SETTLE_S:
        try:
            with quiet_mujoco():
                for _ in range(max(1, round(0.1 / model.opt.timestep))):
                    mujoco.mj_fwdPosition(model, data)  # Finds the contacts without solving them.
                    work += _step_work(model, data)
                    if work > MAX_SETTLE_WORK:
                        break
                    mujoco.mj_step(model, data)
        except mujoco.FatalError as err:
            said = " ".join(str(err).split())
            raise SceneError(
                f"MuJoCo cannot simulate the world ({said}): give it more memory by <size memory=.../> in the file, or "
                "import it without --settle."
            ) from err
        if work > MAX_SETTLE_WORK:
            raise SceneError(
                f"The world has {model.nv} degrees of freedom and {data.ncon} contacts, which are too many to settle: "
                f"{data.time:.3g} s of at most {_SETTLE_S:g} s took all of the allowed work. Import it without "
                f"--settle, or set ANM_MJ_MAX_SETTLE_WORK above {MAX_SETTLE_WORK} if it should take so long."
            )
        # MuJoCo resets a simulation that diverges.
        if data.time < 0.05 or any(data.warning[int(kind)].number for kind in divergences):
            raise SceneError(
                "The bodies of the world do not come to rest, they fly apart (its simulation is unstable): import it "
                "without --settle."
            )
        if abs(data.qvel).max() < _REST:
            break


def _step_work(model: mujoco.MjModel, data: mujoco.MjData) -> int:
    """What a step from here costs, about (:data:`MAX_SETTLE_WORK`): touching bodies are solved together."""
    together = data.island_nv if data.nisland else [model.nv if data.nefc else 0]
    return data.nefc + model.nv + sum(int(freedoms) ** 3 for freedoms in together) // 1500


def up_axis(model: mujoco.MjModel) -> Literal["x", "y", "z"]:
    """The axis against gravity; z where there is none, or it is slanted. Raises SceneError if it is no number."""
    up = -np.asarray(model.opt.gravity, dtype=np.float64)
    if not np.isfinite(up).all():
        raise SceneError(f"The gravity {model.opt.gravity} of the world is no number: repair <option gravity=.../>.")
    strength = float(np.linalg.norm(up))
    axis = int(np.argmax(up))
    if strength == 0.0 or up[axis] < 0.9 * strength:
        return "z"
    return ("x", "y", "z")[axis]
