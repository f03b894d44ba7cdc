"""The top-down map of a run for navigation: ROS's ``map.yaml`` with its image, and the Voronoi graph as a graph."""

import json
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from PIL import Image

from anm_mj.errors import RunFolderError
from anm_mj.io.plan_file import read_plan
from anm_mj.io.read_run import Run
from anm_mj.io.to_json import to_json
from anm_mj.io.write import writing
from anm_mj.replay.timeline import Timeline, known_pieces
from anm_mj.types import FREE, OCCUPIED, Plan, TopDownMap, VoronoiGraph

FREE_GREY, OCCUPIED_GREY, UNKNOWN_GREY = 254, 0, 205
"""Greys of ROS's map_server; 205 is unknown with the thresholds below."""
OCCUPIED_THRESHOLD, FREE_THRESHOLD = 0.65, 0.196


def export_nav2(run: Run, out: Path) -> list[Path]:
    """``map.yaml`` and ``map.pgm``, as nav2's and ROS 1's map_server read them. Raises RunFolderError if the run has no
    top-down map, or the files cannot be written.
    """
    topdown = survey_of(run).topdown
    assert isinstance(topdown, TopDownMap)
    grey = np.full(topdown.state.shape, UNKNOWN_GREY, np.uint8)
    grey[topdown.state == FREE] = FREE_GREY
    grey[topdown.state == OCCUPIED] = OCCUPIED_GREY
    x, y = topdown.origin_xy_m.tolist()
    lines = (
        "image: map.pgm",
        "mode: trinary",
        f"resolution: {topdown.resolution_m!r}",
        f"origin: [{x!r}, {y!r}, 0.0]",
        "negate: 0",
        f"occupied_thresh: {OCCUPIED_THRESHOLD}",
        f"free_thresh: {FREE_THRESHOLD}",
    )
    with writing(out / "map.yaml"):
        # The first row of an image is the north, the first of a grid the south.
        Image.fromarray(grey[::-1]).save(out / "map.pgm")
        (out / "map.yaml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return [out / "map.yaml", out / "map.pgm"]


def export_graphml(run: Run, out: Path) -> list[Path]:
    """``graph.graphml``: vertices with ``x_m``, ``y_m``, ``clearance_m``, edges with ``length_m``. Raises
    RunFolderError if the run has no graph, or the file cannot be written.
    """
    graph = _graph_of(run)
    root = ElementTree.Element("graphml", xmlns="http://graphml.graphdrawing.org/xmlns")
    for name, owner in (("x_m", "node"), ("y_m", "node"), ("clearance_m", "node"), ("length_m", "edge")):
        ElementTree.SubElement(root, "key", {"id": name, "for": owner, "attr.name": name, "attr.type": "double"})
    drawn = ElementTree.SubElement(root, "graph", edgedefault="undirected")
    for k, ((x, y), clearance) in enumerate(zip(graph.vertex_xy_m.tolist(), graph.clearance_m.tolist(), strict=True)):
        _with_data(drawn, "node", {"id": str(k)}, {"x_m": x, "y_m": y, "clearance_m": clearance})
    for (a, b), length in zip(graph.edges.tolist(), graph.edge_length_m.tolist(), strict=True):
        _with_data(drawn, "edge", {"source": str(a), "target": str(b)}, {"length_m": length})
    path = out / "graph.graphml"
    with writing(path):
        ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
    return [path]


def export_geojson(run: Run, out: Path) -> list[Path]:
    """``graph.geojson``: vertices, edges, regions of interest and the trajectory, a line for each piece between frames
    whose pose was not known, in metres of the world. Raises RunFolderError if the run has no graph, or the file cannot
    be written.
    """
    graph, survey = _graph_of(run), survey_of(run)
    features = [
        _feature("Point", xy, kind="vertex", index=k, clearance_m=clearance)
        for k, (xy, clearance) in enumerate(zip(graph.vertex_xy_m, graph.clearance_m, strict=True))
    ]
    features += [
        _feature("LineString", graph.vertex_xy_m[edge], kind="edge", vertices=edge, length_m=length)
        for edge, length in zip(graph.edges, graph.edge_length_m, strict=True)
    ]
    features += [
        _feature("Point", region.centre_m, kind="region", num_members=region.num_members, score=region.score)
        for region in survey.regions
    ]
    pieces = known_pieces(Timeline(run), len(run.frames) - 1)
    # A line has two ends.
    features += [_feature("LineString", piece, kind="trajectory") for piece in pieces if len(piece) > 1]
    return _written(out / "graph.geojson", features, coordinates_in="metres, world frame")


def export_route(run: Run, out: Path) -> list[Path]:
    """``route.geojson``: the Voronoi graph as nav2's route server loads it, each edge in both directions.

    Edges cost their length [m]. Vertices that no edge reaches are left out. Raises RunFolderError if the run has no
    graph, the graph has no edge, or the file cannot be written.
    """
    graph = _graph_of(run)
    if not len(graph.edges):
        raise RunFolderError(f"The Voronoi graph of {run.folder.path} has no edge, and no route is in it.")
    xy = graph.vertex_xy_m
    nodes = np.unique(graph.edges).tolist()
    features = [_feature("Point", xy[k], id=k, frame="map") for k in nodes]
    both = np.concatenate([graph.edges, graph.edges[:, ::-1]]).tolist()
    # No edge has the number of a vertex.
    features += [
        _feature("MultiLineString", [[xy[a], xy[b]]], id=len(xy) + number, startid=a, endid=b, cost=length)
        for number, ((a, b), length) in enumerate(zip(both, np.tile(graph.edge_length_m, 2), strict=True))
    ]
    return _written(out / "route.geojson", features, name="graph")


def survey_of(run: Run) -> Plan:
    """Top-down map, graph and regions of the final map; of the last decision where the run did not end. Raises
    RunFolderError if the run kept neither.
    """
    kept = [run.folder.survey, *(run.folder.plan(plan["step"]) for plan in reversed(run.plans))]
    for path in kept:
        if path.is_file():
            record = read_plan(path)
            if record.topdown is not None:
                return record
    raise RunFolderError(
        f"{run.folder.path} holds no top-down map: it was written by an older version, or with record.plans=false and "
        "not ended; explore again."
    )


def _graph_of(run: Run) -> VoronoiGraph:
    graph = survey_of(run).graph
    if graph is None:
        raise RunFolderError(f"{run.folder.path} holds no Voronoi graph: its policy makes none, and it did not end.")
    return graph


def _with_data(parent: ElementTree.Element, tag: str, attributes: dict[str, str], data: dict[str, float]) -> None:
    element = ElementTree.SubElement(parent, tag, attributes)
    for key, value in data.items():
        ElementTree.SubElement(element, "data", key=key).text = repr(value)


def _written(path: Path, features: list[dict[str, Any]], **about: str) -> list[Path]:
    whole = {"type": "FeatureCollection", **about, "features": features}
    with writing(path):
        path.write_text(json.dumps(to_json(whole)) + "\n", encoding="utf-8")
    return [path]


def _feature(kind_of_geometry: str, coordinates: Any, **properties: Any) -> dict[str, Any]:
    geometry = {"type": kind_of_geometry, "coordinates": coordinates}
    return {"type": "Feature", "geometry": geometry, "properties": properties}
