import numpy as np
import pytest

from anm_mj.scene import build, chunks
from anm_mj.scene.build import build_model
from anm_mj.scene.mjcf import VISUAL_GROUP, read_msh, write_msh
from anm_mj.scene.submesh import Submesh
from anm_mj.scene.writer import SceneInfo, write_scene
from tests.scene.shapes import room


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    mesh = room().subdivide().subdivide().subdivide()
    uv = np.random.default_rng(0).uniform(0.0, 1.0, (len(mesh.vertices), 2))
    texture = np.full((8, 8, 3), 90, np.uint8)
    part = Submesh("walls", mesh.vertices.astype(np.float32), mesh.faces.astype(np.int32), uv=uv, texture=texture)
    return write_scene([part], SceneInfo("room", "tests", "CC0"), tmp_path_factory.mktemp("scene") / "room")


@pytest.fixture
def always(monkeypatch):
    monkeypatch.setattr(build, "MIN_TRIANGLES", 0)


def _corners(model) -> np.ndarray:
    """World corners and texture coordinates of all visual triangles, ordered by the latter."""
    import mujoco

    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    rows = []
    for geom in np.flatnonzero(model.geom_group == VISUAL_GROUP):
        mesh = model.mesh(model.geom_dataid[geom])
        faces = model.mesh_face[mesh.faceadr[0] : mesh.faceadr[0] + mesh.facenum[0]]
        local = model.mesh_vert[mesh.vertadr[0] : mesh.vertadr[0] + mesh.vertnum[0]][faces]
        uv_faces = model.mesh_facetexcoord[mesh.faceadr[0] : mesh.faceadr[0] + mesh.facenum[0]]
        uv = model.mesh_texcoord[mesh.texcoordadr[0] :][uv_faces]
        world = local @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
        rows.append(np.concatenate([world.reshape(-1, 9), uv.reshape(-1, 6)], axis=1))
    together = np.concatenate(rows)
    return together[np.lexsort(together[:, 9:].round(4).T)]


def test_the_chunks_are_the_mesh(scene, monkeypatch):
    whole = build_model(scene)
    monkeypatch.setattr(build, "MIN_TRIANGLES", 0)
    chunked = build_model(scene)
    visual = chunked.geom_group == VISUAL_GROUP
    assert np.count_nonzero(visual) > 10
    assert not chunked.geom_contype[visual].any()
    assert not chunked.geom_conaffinity[visual].any()
    assert chunked.body_mass.sum() == 0.0
    np.testing.assert_allclose(_corners(chunked), _corners(whole), atol=2e-4)


def test_a_chunk_is_no_larger_than_its_cell_and_a_triangle(scene, always):
    model = build_model(scene)
    half = model.geom_aabb[model.geom_group == VISUAL_GROUP, 3:]
    longest_edge_m = 6.2 * 2**0.5 / 8
    assert half.max() < (chunks.CHUNK_M * 3**0.5 + 2 * longest_edge_m) / 2


def test_small_scenes_stay_whole(scene):
    assert build_model(scene).nmesh == 1


@pytest.mark.parametrize("textured", [True, False])
def test_a_mesh_file_reads_as_it_was_written(tmp_path, textured):
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]], np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    uv = np.array([[0.0, 0.25], [1.0, 0.5], [0.5, 0.75], [0.25, 1.0]]) if textured else None
    write_msh(tmp_path / "a.msh", vertices, faces, uv)
    read_vertices, read_uv, read_faces = read_msh(tmp_path / "a.msh")
    assert np.array_equal(read_vertices, vertices)
    assert np.array_equal(read_faces, faces)
    assert len(read_uv) == (4 if textured else 0)
    if uv is not None:
        assert np.allclose(read_uv[:, 1], 1.0 - uv[:, 1])


def test_a_cut_off_mesh_file_is_refused(tmp_path):
    write_msh(tmp_path / "a.msh", np.zeros((4, 3)), np.zeros((2, 3), np.int32), None)
    (tmp_path / "a.msh").write_bytes((tmp_path / "a.msh").read_bytes()[:-4])
    with pytest.raises(ValueError, match="bytes long instead of"):
        read_msh(tmp_path / "a.msh")
