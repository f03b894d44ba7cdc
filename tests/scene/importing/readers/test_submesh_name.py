"""Which submeshes of a mesh file a Gazebo world means by a name."""

import json

import pytest

from anm_mj.scene.importing.readers.submesh_name import named_submeshes, nodes_of
from tests.scene.importing.readers.collada import collada, geometry
from tests.scene.importing.readers.gazebo_worlds import read_parts, write_world
from tests.scene.importing.readers.test_gltf_check import write_gltf


def _picked(tmp_path, wanted: str, file: str) -> list[str]:
    mesh = f"<mesh><uri>{file}</uri><submesh><name>{wanted}</name></submesh></mesh>"
    model = f"<model name='m'><link name='l'><visual name='v'><geometry>{mesh}</geometry></visual></link></model>"
    ground = "<include><uri>model://ground_plane</uri></include>"
    parts, _ = read_parts(write_world(tmp_path / "w.sdf", ground + model))
    return [part.name for part in parts if part.name != "ground_plane_visual"]


@pytest.mark.parametrize(
    ("wanted", "ids", "found"),
    [
        ("Door", ["Door-mesh", "Door_frame-mesh", "Door.001-mesh", "_1-mesh", "_Wall-mesh"], ["Door-mesh"]),
        ("door", ["Door", "Door-mesh", "Door_lib"], ["Door"]),
        ("Door", ["Door.geometry", "Doors-mesh"], ["Door.geometry"]),
        ("Door", ["Door_frame-mesh", "_1-mesh"], []),
    ],
)
def test_a_geometry_has_the_name_itself_or_with_a_word_of_its_exporter(tmp_path, wanted, ids, found):
    text = collada("".join(map(geometry, ids)), [(f"node{k}", name) for k, name in enumerate(ids)])
    (tmp_path / "a.dae").write_text(text)
    assert _picked(tmp_path, wanted, "a.dae") == found


def test_the_name_of_a_node_goes_before_those_of_geometries(tmp_path):
    ids = ["Cube_001-mesh", "Door-mesh"]
    (tmp_path / "a.dae").write_text(
        collada("".join(map(geometry, ids)), [("Door", "Cube_001-mesh"), ("Wall", "Door-mesh")])
    )
    assert _picked(tmp_path, "Door", "a.dae") == ["Cube_001-mesh"]
    assert _picked(tmp_path, "Wall", "a.dae") == ["Door-mesh"]


@pytest.mark.parametrize("file", ["a.dae", "a.gltf"])
def test_all_materials_of_a_geometry_are_of_its_name(tmp_path, file):
    (tmp_path / "a.dae").write_text(
        collada(geometry("Door", surfaces=("", "")) + geometry("Door_7"), [("one", "Door"), ("two", "Door_7")])
    )

    def two_primitives(header):
        (mesh,) = header["meshes"]
        header["meshes"] = [{"primitives": mesh["primitives"] * 2, "name": "Door"}, {**mesh, "name": "Door_7"}]
        header["nodes"] = [{"mesh": 0}, {"mesh": 1}]
        header["scenes"] = [{"nodes": [0, 1]}]

    write_gltf(tmp_path / "a.gltf", two_primitives)
    assert sorted(_picked(tmp_path, "Door", file)) == ["Door", "Door_1"]
    assert _picked(tmp_path, "Door_7", file) == ["Door_7"]


@pytest.mark.parametrize(
    ("name", "text"),
    [("a.dae", "<"), ("a.gltf", "{}"), ("a.gltf", json.dumps({"nodes": [{"mesh": 3}]})), ("a.obj", "")],
)
def test_a_file_whose_nodes_cannot_be_read_has_none(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    assert not nodes_of(tmp_path / name)
    assert named_submeshes({}, [], "Door") == []
