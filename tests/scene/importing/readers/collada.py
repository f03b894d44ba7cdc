"""Small COLLADA files."""

from collections.abc import Sequence

TRIANGLE = ((0, 0, 0), (1, 0, 0), (0, 1, 0))


def geometry(name: str, points: Sequence[Sequence[float]] = TRIANGLE, surfaces: Sequence[str] = ("",)) -> str:
    """A geometry; each surface is a primitive over its points, and an empty one the first triangle."""
    numbers = " ".join(str(number) for point in points for number in point)
    vertex = f'<input offset="0" semantic="VERTEX" source="#{name}v"/>'
    first = f'<triangles count="1">{vertex}<p>0 1 2</p></triangles>'
    return (
        f'<geometry id="{name}"><mesh><source id="{name}p"><float_array id="{name}a" count="{3 * len(points)}">'
        f'{numbers}</float_array><technique_common><accessor source="#{name}a" count="{len(points)}" stride="3">'
        '<param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/></accessor>'
        f'</technique_common></source><vertices id="{name}v"><input semantic="POSITION" source="#{name}p"/></vertices>'
        f"{''.join(surface.replace('VERTEX', vertex) or first for surface in surfaces)}</mesh></geometry>"
    )


def collada(geometries: str, nodes: Sequence[tuple[str, str]]) -> str:
    """A file whose scene has nodes of a name that place a geometry of an id."""
    placed = "".join(f'<node name="{name}"><instance_geometry url="#{url}"/></node>' for name, url in nodes)
    return (
        '<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">'
        f"<library_geometries>{geometries}</library_geometries><library_visual_scenes><visual_scene "
        f'id="s">{placed}</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene>'
        "</COLLADA>"
    )
