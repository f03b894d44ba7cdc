"""Polygons of COLLADA files that are not convex."""

import numpy as np
import pytest

from anm_mj.scene.importing.readers.collada_check import check_collada
from anm_mj.scene.importing.readers.import_report import ImportReport
from anm_mj.scene.importing.readers.read_mesh import read_mesh
from anm_mj.scene.submesh import merge_geometry
from tests.scene.importing.readers.collada import collada, geometry
from tests.scene.importing.readers.test_obj_check import L_SHAPE, U_SHAPE

_SQUARE = [(10, 0), (12, 0), (12, 2), (10, 2)]


def area_m2(triangles):
    return np.linalg.norm(np.cross(*(triangles[:, 1:] - triangles[:, :1]).transpose(1, 0, 2)), axis=1).sum() / 2.0


def _write(path, outlines, kind):
    """Outlines at z = 1, which name their corners twice, in columns 0 and 2 of three."""
    rows, first = [], 0
    for outline in outlines:
        rows.append(" ".join(f"{first + k} 0 {first + k}" for k in range(len(outline))))
        first += len(outline)
    lists = "".join(f"<p>{row}</p>" for row in rows)
    counts = " ".join(str(len(outline)) for outline in outlines)
    inner = lists if kind == "polygons" else f"<vcount>{counts}</vcount><p>{' '.join(rows)}</p>"
    normal = '<input offset="2" semantic="NORMAL" source="#gp"/>'
    surface = f'<{kind} count="{len(outlines)}">VERTEX{normal}{inner}</{kind}>'
    points = [(x, y, 1.0) for outline in outlines for x, y in outline]
    path.write_text(collada(geometry("g", points, [surface]), [("node", "g")]))
    return path


@pytest.mark.parametrize("kind", ["polylist", "polygons"])
@pytest.mark.parametrize(("outline", "area"), [(L_SHAPE, 26.0), (U_SHAPE, 45.0), (L_SHAPE[::-1], 26.0)])
def test_polygons_that_are_not_convex_are_not_reached_beyond(tmp_path, kind, outline, area):
    src = _write(tmp_path / "a.dae", [_SQUARE, outline, _SQUARE], kind)
    report = ImportReport()
    vertices, faces = merge_geometry(read_mesh(src, report))
    assert area_m2(vertices[faces]) == pytest.approx(area + 8.0)
    assert not report.sentences()


@pytest.mark.parametrize("kind", ["polylist", "polygons"])
def test_convex_polygons_stay_as_they_are_written(tmp_path, kind):
    assert not check_collada(_write(tmp_path / "a.dae", [_SQUARE, _SQUARE], kind), ImportReport()).uneven


@pytest.mark.parametrize(
    ("old", "new"), [("<p>0 0 0", "<p>0 x 0"), ('source="#gv"', 'source="#gone"'), ("<p>0 0", "<p>0")]
)
def test_what_names_nothing_is_left_to_the_reader(tmp_path, old, new):
    src = _write(tmp_path / "a.dae", [L_SHAPE], "polylist")
    src.write_text(src.read_text().replace(old, new))
    assert not check_collada(src, ImportReport()).uneven
