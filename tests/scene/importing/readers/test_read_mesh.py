import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.exchange.gltf import export_glb

from anm_mj.errors import SceneError
from anm_mj.scene.importing.import_scene import import_scene
from anm_mj.scene.importing.readers.import_report import ImportReport
from anm_mj.scene.importing.readers.read_mesh import read_mesh, usual_up
from tests.scene.furnished import BOUNDS_M, furnished, looks_at_the_poster, write_glb, write_obj
from tests.scene.glb import patch_glb
from tests.scene.importing.readers.collada import collada, geometry
from tests.scene.shapes import to_y_up
from tests.scene.view import is_shade_of, look


def _furnished_glb(path, **extensions):
    path.write_bytes(export_glb(trimesh.Scene([to_y_up(mesh) for mesh in furnished()]), **extensions))
    return path


@pytest.mark.parametrize("extension", ["extension_draco", "extension_webp"])
def test_draco_triangles_and_webp_textures_are_decoded(tmp_path, caplog, extension):
    scene = import_scene(_furnished_glb(tmp_path / "a.glb", **{extension: True}), tmp_path / "out")
    # Draco keeps 14 bits of 6.2 m.
    assert np.allclose(scene.bounds_m, BOUNDS_M, atol=2e-3)
    assert looks_at_the_poster(scene)
    assert not [record for record in caplog.records if record.levelname == "WARNING"]


@pytest.mark.parametrize("extension", ["KHR_texture_basisu", "GOOGLE_texture_basis"])
def test_basis_textures_give_plain_surfaces_and_one_sentence(tmp_path, caplog, extension):
    def compress(header):
        header["extensionsUsed"] = [extension]
        header["textures"] = [{"extensions": {extension: {"source": 0}}}]

    src = patch_glb(_furnished_glb(tmp_path / "a.glb"), compress)
    scene = import_scene(src, tmp_path / "out")
    (said,) = [record.getMessage() for record in caplog.records if record.levelname == "WARNING"]
    assert said.startswith("Basis Universal textures")
    assert "a.glb" in said
    assert scene.num_triangles == sum(len(mesh.faces) for mesh in furnished())
    # Grey, as surfaces without colour are, and not the white of a material without its texture.
    assert is_shade_of(look(scene, (3.0, 2.9, 1.5), (1.0, 0.0, 0.0))[32, 32], (178, 178, 178))


def test_a_basis_texture_with_an_ordinary_one_beside_it_shows(tmp_path, caplog):
    def compress(header):
        header["extensionsUsed"] = ["KHR_texture_basisu"]
        header["textures"] = [{"source": 0, "extensions": {"KHR_texture_basisu": {"source": 1}}}]
        header["images"].append(header["images"][0])

    assert looks_at_the_poster(import_scene(patch_glb(_furnished_glb(tmp_path / "a.glb"), compress), tmp_path / "out"))
    assert "Basis" not in caplog.text


def test_coordinates_as_normalised_integers_are_refused_with_the_way_out(tmp_path):
    def quantise(header):
        header["accessors"][header["meshes"][0]["primitives"][0]["attributes"]["POSITION"]]["normalized"] = True

    with pytest.raises(SceneError, match="gltf-transform dequantize"):
        import_scene(patch_glb(_furnished_glb(tmp_path / "a.glb"), quantise), tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("unit", [1.0, 0.001])
def test_an_stl_has_no_colour_and_often_millimetres(tmp_path, unit):
    mesh = trimesh.util.concatenate([mesh for mesh in furnished() if len(mesh.faces) > 2])
    mesh.apply_scale(1.0 / unit)
    mesh.export(tmp_path / "a.stl")
    scene = import_scene(tmp_path / "a.stl", tmp_path / "out")
    assert np.allclose(scene.bounds_m, BOUNDS_M, atol=1e-3)
    assert is_shade_of(look(scene, (3.0, 2.9, 1.5), (1.0, 0.0, 0.0))[32, 32], (178, 178, 178))


def test_a_texture_is_found_where_it_was_moved_to(tmp_path, caplog):
    # Written on another system, and kept where Gazebo's models keep them.
    src = write_obj(tmp_path / "chair" / "meshes" / "a.obj", texture="..\\maps\\picture.jpg")
    (tmp_path / "chair" / "materials" / "textures").mkdir(parents=True)
    (src.parent / "picture.jpg").rename(tmp_path / "chair" / "materials" / "textures" / "picture.jpg")
    assert looks_at_the_poster(import_scene(src, tmp_path / "out", up="z"))
    assert "Not found" not in caplog.text


def _dae(path, unit: float, up: str):
    mesh = trimesh.util.concatenate([mesh for mesh in furnished() if len(mesh.faces) > 2])
    mesh = to_y_up(mesh) if up == "Y" else mesh
    mesh.apply_scale(1.0 / unit)
    path.write_bytes(trimesh.exchange.dae.export_collada(mesh))
    text = path.read_text()
    asset = f'<unit name="own" meter="{unit}"/><up_axis>{up}_UP</up_axis>'
    path.write_text(text.replace("<up_axis>Y_UP</up_axis>", asset))
    return path


@pytest.mark.parametrize(("unit", "up"), [(0.0254, "Z"), (0.01, "Y")])
def test_a_collada_file_has_the_unit_and_the_up_axis_that_it_states(tmp_path, unit, up):
    src = _dae(tmp_path / "a.dae", unit, up)
    assert usual_up(src) == up.lower()
    assert np.allclose(import_scene(src, tmp_path / "out").bounds_m, BOUNDS_M, atol=2e-3)


def test_a_texture_that_many_meshes_share_is_kept_once(tmp_path):
    one, other = furnished()[1], furnished()[1]
    other.apply_translation([0.0, -2.0, 0.0])
    other.visual.material = one.visual.material
    parts = read_mesh(write_glb(tmp_path / "a.glb", one, other), ImportReport())
    assert parts[0].texture is parts[1].texture
    assert len({id(part.texture) for part in parts}) == 1


def test_a_mirrored_node_keeps_its_outside_outside(tmp_path):
    scene = trimesh.Scene()
    scene.add_geometry(furnished()[3], transform=np.diag([-1.0, 1.0, 1.0, 1.0]))
    scene.export(tmp_path / "a.glb")
    (part,) = read_mesh(tmp_path / "a.glb", ImportReport())
    assert trimesh.Trimesh(part.vertices_m, part.faces).volume == pytest.approx(0.5 * 1.0 * 1.8, rel=1e-5)


def test_a_picture_that_cannot_be_decoded_is_survived(tmp_path):
    src = write_obj(tmp_path / "a.obj")
    (tmp_path / "picture.jpg").write_bytes(b"no picture")
    assert import_scene(src, tmp_path / "out", up="z").num_triangles > 0


def _coloured(folder, suffix, colours, diffuse, shader=""):
    """A square of corners of ``colours`` and a material of a diffuse colour, or of what else a COLLADA file says."""
    points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    if suffix == "obj":
        (folder / "a.mtl").write_text(f"newmtl m\nKd {diffuse}\n")
        rows = "".join(f"v {x} {y} {z} {colour}\n" for (x, y, z), colour in zip(points, colours, strict=True))
        (folder / "a.obj").write_text(f"mtllib a.mtl\n{rows}usemtl m\nf 1 2 3\nf 1 3 4\n")
    else:
        colour = '<input offset="0" semantic="COLOR" source="#cp"/>'
        surface = f'<triangles material="m" count="2">VERTEX{colour}<p>0 1 2 0 2 3</p></triangles>'
        source = (
            f'<source id="cp"><float_array id="ca" count="12">{" ".join(colours)}</float_array><technique_common>'
            '<accessor source="#ca" count="4" stride="3"><param name="R" type="float"/><param name="G" type="float"/>'
            '<param name="B" type="float"/></accessor></technique_common></source><vertices'
        )
        text = collada(geometry("g", points, [surface]).replace("<vertices", source), [("node", "g")])
        shader = shader or f"<diffuse><color>{diffuse} 1</color></diffuse>"
        material = (
            '<library_images><image id="p"><init_from>p.png</init_from></image></library_images>'
            '<library_effects><effect id="e"><profile_COMMON><technique sid="c"><lambert>'
            f"{shader}</lambert></technique></profile_COMMON></effect></library_effects>"
            '<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>'
            "<library_geometries>"
        )
        bound = (
            '<instance_geometry url="#g"><bind_material><technique_common><instance_material symbol="m" target="#m"/>'
            "</technique_common></bind_material></instance_geometry>"
        )
        text = text.replace('<instance_geometry url="#g"/>', bound).replace("<library_geometries>", material)
        (folder / "a.dae").write_text(text)
    (part,) = read_mesh(folder / f"a.{suffix}", ImportReport())
    return part


@pytest.mark.parametrize("suffix", ["obj", "dae"])
def test_colours_of_vertices_show_through_a_plain_material(tmp_path, suffix):
    part = _coloured(tmp_path, suffix, ["1 0 0", "1 0 0", "0 1 0", "0 1 0"], "1 0.5 1")
    assert part.texture is not None
    # Those of the vertices times that of the material.
    for rgb in ((255, 0, 0), (0, 128, 0)):
        assert (part.texture == rgb).all(axis=-1).any()


@pytest.mark.parametrize("suffix", ["obj", "dae"])
def test_a_material_keeps_its_colour_where_every_vertex_has_the_same(tmp_path, suffix):
    part = _coloured(tmp_path, suffix, ["0.5 0.5 0.5"] * 4, "1 0 0")
    assert part.texture is None
    assert part.rgb == (1.0, 0.0, 0.0)


def test_a_node_of_several_materials_is_one_part_of_its_name(tmp_path):
    scene = trimesh.Scene()
    for name, low in (("Door", 0.0), ("Door_handle", 2.0)):
        scene.add_geometry(trimesh.creation.box(bounds=[[low, 0, 0], [low + 1, 1, 1]]), node_name=name, geom_name=name)

    def divide(header):
        for mesh in header["meshes"]:
            mesh["primitives"] *= 2

    src = tmp_path / "a.glb"
    scene.export(src)
    parts = read_mesh(patch_glb(src, divide), ImportReport())
    assert sorted(part.part for part in parts) == ["Door", "Door", "Door_handle", "Door_handle"]
    assert import_scene(src, tmp_path / "out", leave_out=["door"]).bounds_m[0, 0] == pytest.approx(2.0)


@pytest.mark.parametrize("picture", [True, False])
def test_a_black_surface_that_glows_has_the_colour_of_its_light(tmp_path, picture):
    def glow(header):
        (material,) = header["materials"]
        own = material["pbrMetallicRoughness"]
        texture = own.pop("baseColorTexture")
        own["baseColorFactor"] = [0, 0, 0, 1]
        material["emissiveFactor"] = [1, 0.6, 0]
        if picture:
            material["emissiveTexture"] = texture

    (before,) = read_mesh(write_glb(tmp_path / "a.glb", furnished()[1]), ImportReport())
    (part,) = read_mesh(patch_glb(tmp_path / "a.glb", glow), ImportReport())
    assert part.rgb == pytest.approx((1.0, 0.6, 0.0))
    assert np.array_equal(part.texture, before.texture) if picture else part.texture is None


@pytest.mark.parametrize("diffuse", ["", "<diffuse><color>0 0 0.0 1</color></diffuse>"])
def test_a_black_collada_surface_that_glows_has_the_colour_of_its_light(tmp_path, diffuse):
    light = "<emission><color>1 0.6 0 1</color></emission>"
    assert _coloured(tmp_path, "dae", ["1 1 1"] * 4, "0 0 0", light + diffuse).rgb == pytest.approx((1.0, 0.6, 0.0))


@pytest.mark.parametrize(("diffuse", "shows"), [("0 0 0", True), ("0.2 0.4 0.6", False)])
def test_a_picture_of_light_in_a_collada_file_is_read_or_left_out(tmp_path, caplog, diffuse, shows):
    Image.new("RGB", (8, 8), (10, 200, 10)).save(tmp_path / "p.png")
    light = f'<emission><texture texture="p" texcoord="UV"/></emission><diffuse><color>{diffuse} 1</color></diffuse>'
    part = _coloured(tmp_path, "dae", ["1 1 1"] * 4, "0 0 0", light)
    # It has no texture coordinates.
    assert part.rgb == pytest.approx((1.0, 1.0, 1.0) if shows else (0.2, 0.4, 0.6))
    assert not caplog.records
