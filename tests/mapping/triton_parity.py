"""The Triton engine against the torch engine, in a process of its own: prints what was found, as JSON.

Triton brings an LLVM that crashes if loaded beside a software GL renderer's, so pytest's own process, which renders,
must not load it. Run with ``TRITON_INTERPRET=1`` where there is no GPU; the kernels then run on the host, and slowly.
"""

import json
import sys
import warnings
from contextlib import contextmanager, nullcontext
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import install_import_hook

import tests.typechecker  # noqa: F401  The hook finds it by name, as an attribute of tests.

install_import_hook("anm_mj", "tests.typechecker.check")

from anm_mj.errors import MapError  # noqa: E402
from anm_mj.mapping.backends.select import choose_engine, make_backend, triton_fault  # noqa: E402
from anm_mj.mapping.backends.torch_backend import TorchBackend  # noqa: E402
from anm_mj.mapping.backends.triton import field, training_step  # noqa: E402
from anm_mj.mapping.backends.triton.backend import TritonBackend  # noqa: E402
from anm_mj.mapping.backends.triton.captured import Captured  # noqa: E402
from anm_mj.mapping.backends.triton.pixels import DeviceRays  # noqa: E402
from anm_mj.mapping.config import default_mapping, paper_mapping  # noqa: E402
from anm_mj.mapping.keyframes import KeyframeStore  # noqa: E402
from anm_mj.mapping.neural_map import NeuralMap  # noqa: E402
from anm_mj.mapping.parameters import DECODER_NAMES  # noqa: E402
from anm_mj.mapping.rays import RayBatch, concatenate, part, sample_frame  # noqa: E402
from anm_mj.mapping.sampling import sample_depths  # noqa: E402
from tests.mapping.ray_room import Room  # noqa: E402
from tests.mapping.recorded_graph import RecordedGraph, RecordedKernel, record  # noqa: E402
from tests.mapping.reference import reference_gradients  # noqa: E402

CORNER_M = np.array([0.3, 0.4, 0.1])
STEPS = 50 if torch.cuda.is_available() else 5
"""Few in the interpreter, which takes tenths of a second for one."""


def configs():
    """Both sampling schemes and sizes that are no power of two; small, because the interpreter is slow."""
    guided, uniform = default_mapping(), paper_mapping()
    guided = replace(
        guided,
        field=replace(guided.field, num_levels=4, log2_table_size=9, finest_cell_m=0.05),
    )
    field = replace(guided.field, num_levels=3, blob_bins=7, hidden_width=20, geometry_features=5)
    loss = replace(uniform.loss, smoothness=0.3, smoothness_points=3)
    sampling = replace(uniform.sampling, free_samples=9, near_samples=4)
    return {"guided": guided, "uniform": replace(uniform, field=field, loss=loss, sampling=sampling)}


def make_rays() -> RayBatch:
    """Some with depth, some into the sky, which the room is open to; a number that fills no tile."""
    room = Room(ceiling=False)
    rng = np.random.default_rng(0)
    return concatenate(*(sample_frame(room.observe(1.5, 1.5, yaw, size=16), 35, rng) for yaw in (0.4, 2.0)))


def relative_error(ours, theirs):
    return float(np.linalg.norm(ours.astype(np.float64) - theirs) / np.linalg.norm(theirs))


def largest(ours, theirs):
    return float(np.max(np.abs(np.asarray(ours, np.float64) - theirs)))


def compare(config, rays):
    found = {}
    corner = CORNER_M if config.loss.smoothness > 0.0 else None
    ours = TritonBackend(config, seed=0)
    reference = TorchBackend(config, seed=1, device="cpu")

    depth = np.concatenate((rays.depth_m, np.float32([0.05, 0.1, 9.99, 10.0, 10.01, 0.0, -1.0, np.inf])))
    z = sample_depths(torch.from_numpy(depth), config.sampling, config.field.truncation_m, 2**40 + 7)
    found["same_samples"] = bool((ours.sample_depths(depth, 2**40 + 7) == z.numpy()).all())

    # Off the start values, where gradients of the table are tiny.
    for seed in range(10):
        reference.step(rays, seed, corner)
    ours.set_state(reference.get_state())
    z = ours.sample_depths(rays.depth_m, 3)
    losses, gradients = ours.gradients(rays, 3, corner)
    for dtype in (torch.float32, torch.float64):
        expected_losses, expected = reference_gradients(reference, rays, z, dtype, corner)
        name = str(dtype).removeprefix("torch.")
        kept = np.abs(expected_losses) > 0.0
        found[f"losses_{name}"] = float(np.max(np.abs(np.array(losses)[kept] / np.array(expected_losses)[kept] - 1.0)))
        found[f"gradients_{name}"] = {key: relative_error(g, expected[key]) for key, g in gradients.items()}

    rng = np.random.default_rng(0)
    points = rng.uniform(-1.0, 4.0, (333, 3))
    state = reference.get_state()
    weights = np.concatenate([state[name].ravel() for name in DECODER_NAMES])
    decoders = weights + 0.02 * rng.standard_normal((3, weights.size)).astype(np.float32)
    render_z = np.sort(rng.uniform(0.0, 4.0, (len(rays.depth_m), 9)).astype(np.float32), axis=1)
    found["query_sdf"] = largest(ours.query_sdf(points), reference.query_sdf(points))
    found["query_rgb"] = largest(ours.query_rgb(points), reference.query_rgb(points))
    found["query_hidden"] = largest(ours.query_hidden(points), reference.query_hidden(points))
    mine, theirs = ours.query_perturbed(points, decoders), reference.query_perturbed(points, decoders)
    found["query_perturbed"] = max(largest(a, b) for a, b in zip(mine, theirs, strict=True))
    mine, theirs = ours.query_sensitivity(points), reference.query_sensitivity(points)
    found["query_sensitivity"] = max(largest(a / b, 1.0) for a, b in zip(mine, theirs, strict=True))
    mine = ours.render(rays.origin_m, rays.direction, render_z)
    theirs = reference.render(rays.origin_m, rays.direction, render_z)
    found["render"] = max(largest(a, b) for a, b in zip(mine, theirs, strict=True))
    found["empty"] = [len(ours.query_sdf(np.zeros((0, 3)))), len(ours.query_rgb(np.zeros((0, 3))))]

    # Both optimisers start afresh; the batch changes its size on the way.
    reference.set_state(ours.get_state())
    found["state_kept"] = all((value == state[name]).all() for name, value in reference.get_state().items())
    for k in range(STEPS):
        batch = part(rays, 0, 60) if k % 5 == 2 else rays
        a, b = (backend.step(batch, k, corner) for backend in (ours, reference))
    kept = np.array(b) > 0.0
    found["losses_after_steps"] = float(np.max(np.abs(np.array(a)[kept] / np.array(b)[kept] - 1.0)))
    hit = np.isfinite(rays.depth_m)
    surface = rays.origin_m[hit] + rays.direction[hit] * rays.depth_m[hit, None]
    found["sdf_after_steps"] = largest(ours.query_sdf(surface), reference.query_sdf(surface))

    other = TritonBackend(config, seed=1)
    other.set_state(ours.get_state())
    found["state_returns"] = all((value == other.get_state()[name]).all() for name, value in ours.get_state().items())
    found["answers_return"] = largest(other.query_sdf(surface), ours.query_sdf(surface))
    return found


def replay(config):
    """Steps by replays of one captured graph on pixels of a store that grows and is thinned meanwhile, and torch's."""
    ours = TritonBackend(config, seed=0)
    reference = TorchBackend(config, seed=0, device="cpu")
    corner = CORNER_M if config.loss.smoothness > 0.0 else None
    room, rng = Room(ceiling=False), np.random.default_rng(0)
    store = KeyframeStore(9 * 600, 1.0, ours.pixel_memory)
    errors, on_device, kept = [], True, []
    for k in range(4):
        view = room.observe(1.5, 1.5, 1.3 * k, size=16)
        store.add(view, rng)
        kept.append(int(store.num_pixels[0]))
        for rays in store.batches(2, 40, view, 20, rng):
            on_device &= isinstance(rays, DeviceRays)
            # Smoothness now and then elsewhere: what a graph was captured with must not stick to it.
            at = None if corner is None else corner + 0.1 * k
            a, b = (np.array(backend.step(rays, len(errors), at)) for backend in (ours, reference))
            errors.append(float(np.max(np.abs(a[b > 0.0] / b[b > 0.0] - 1.0))))
    graph = ours._training._captured._graph
    found = {"losses": max(errors), "on_device": on_device, "kept": kept, "captured": graph is not None}
    if isinstance(graph, RecordedGraph):
        found |= {"replays": graph.num_replays, "names": sorted(set(graph.names))}
    return found


@contextmanager
def recorded_graphs():
    """Has the engine capture where there is no CUDA."""
    originals = {}
    for module in (field, training_step):
        for name in [name for name in vars(module) if name.endswith("_kernel")]:
            originals[module, name] = getattr(module, name)
            setattr(module, name, RecordedKernel(originals[module, name]))
    originals[training_step, "Captured"] = training_step.Captured
    training_step.Captured = lambda launch, enabled: Captured(launch, enabled=True)
    originals[torch.cuda, "CUDAGraph"], originals[torch.cuda, "graph"] = torch.cuda.CUDAGraph, torch.cuda.graph
    torch.cuda.CUDAGraph, torch.cuda.graph = RecordedGraph, record
    try:
        yield
    finally:
        for (module, name), original in originals.items():
            setattr(module, name, original)


def map_on_device(config):
    """A map whose engine keeps the pixels, beside one of the torch engine: losses and the table's growth."""
    config = replace(
        config,
        field=replace(config.field, log2_table_size=8, largest_log2_table_size=9, entries_per_m3=1e6),
        schedule=replace(config.schedule, first_iterations=2, iterations=2, num_rays=40, keyframe_every=1),
    )
    maps = [NeuralMap(replace(config, engine=engine), seed=0) for engine in ("triton", "torch")]
    losses = []
    for k in range(2):
        view = Room().observe(1.5, 1.5, float(k), size=16)
        losses.append([neural_map.integrate(view).loss for neural_map in maps])
    sizes = [neural_map.config.field.log2_table_size for neural_map in maps]
    return {"losses": max(abs(a / b - 1.0) for a, b in losses), "sizes": sizes}


def refusals(config):
    """What is said about states and configurations that do not fit."""
    backend, said = TritonBackend(config, seed=0), []
    state = backend.get_state()
    cut = {**state, "table": state["table"][:10]}
    lacking = {name: value for name, value in state.items() if name != "table"}
    wide = replace(config, field=replace(config.field, hidden_width=2000))
    for attempt in (
        lambda: backend.set_state(cut),
        lambda: backend.set_state(lacking),
        lambda: TritonBackend(wide, seed=0),
    ):
        try:
            attempt()
        except MapError as err:
            said.append(str(err))
    return said


def main() -> None:
    warnings.simplefilter("error")
    torch.set_num_threads(1)
    rays, found = make_rays(), {}
    for name, config in configs().items():
        found[name] = compare(config, rays)
        with nullcontext() if torch.cuda.is_available() else recorded_graphs():
            found[name]["replay"] = replay(config)
    found["map"] = map_on_device(configs()["guided"])
    found["refusals"] = refusals(configs()["guided"])
    found["fault"] = triton_fault()
    found["choice"] = choose_engine("triton", "auto").name
    backend = make_backend(replace(configs()["guided"], engine="triton"), seed=0)
    found["made"] = [backend.name, backend.device]
    json.dump(found, sys.stdout)


if __name__ == "__main__":
    main()
