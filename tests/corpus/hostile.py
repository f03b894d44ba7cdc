"""Inputs that ask for too much, climb out of their folder, or are no files at all."""

from __future__ import annotations

import json
import os
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

Change = Callable[[Path], None]
"""Changes a folder that holds a good input."""


def png(width: int, height: int, rows: int = 1) -> bytes:
    """A PNG that says it has this size, with a few rows of it."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    body = zlib.compress(b"\0" * min(rows * (1 + 3 * width), 50_000_000))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", body) + chunk(b"IEND", b"")


def gltf_bombs() -> dict[str, bytes]:
    """glTF files whose headers ask for more than they bring."""
    accessor = {"componentType": 5126, "count": 10**9, "type": "VEC3"}
    mesh = {"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}
    base = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "meshes": [mesh]}
    buffer = {"uri": "data:application/octet-stream;base64,AAAAAAAAAAAAAAAA", "byteLength": 12}
    view = {"buffer": 0, "byteOffset": 0, "byteLength": 12}
    doubling = [{"children": [k + 1, k + 1]} for k in range(40)] + [{"mesh": 0}]
    bombs = {
        "an accessor of 10^9 without data": {
            **base,
            "nodes": [{"mesh": 0}],
            "accessors": [accessor, {**accessor, "componentType": 5125, "type": "SCALAR"}],
        },
        "an accessor of 10^9 over 12 bytes": {
            **base,
            "nodes": [{"mesh": 0}],
            "buffers": [buffer],
            "bufferViews": [view],
            "accessors": [
                {**accessor, "bufferView": 0},
                {**accessor, "componentType": 5125, "type": "SCALAR", "bufferView": 0},
            ],
        },
        "sparse accessor of 10^9": {
            **base,
            "nodes": [{"mesh": 0}],
            "buffers": [buffer],
            "bufferViews": [view],
            "accessors": [
                {
                    **accessor,
                    "sparse": {
                        "count": 1,
                        "indices": {"bufferView": 0, "componentType": 5125},
                        "values": {"bufferView": 0},
                    },
                }
            ]
            * 2,
        },
        "a buffer of 10^12 bytes": {
            **base,
            "nodes": [{"mesh": 0}],
            "buffers": [{"byteLength": 10**12, "uri": "none.bin"}],
            "accessors": [accessor],
        },
        "nodes that double 40 times": {**base, "nodes": doubling, "accessors": [accessor]},
        "a node that is its own child": {**base, "nodes": [{"children": [0], "mesh": 0}], "accessors": [accessor]},
        "a chain of 100,000 nodes": {
            **base,
            "nodes": [{"children": [k + 1]} for k in range(100_000)] + [{"mesh": 0}],
            "accessors": [accessor],
        },
        "a buffer from outside": {
            **base,
            "nodes": [{"mesh": 0}],
            "buffers": [{"uri": "/etc/passwd", "byteLength": 12}],
            "bufferViews": [view],
            "accessors": [{**accessor, "count": 1, "bufferView": 0}] * 2,
        },
        "a buffer from an address": {
            **base,
            "nodes": [{"mesh": 0}],
            "buffers": [{"uri": "http://127.0.0.1:9/x", "byteLength": 12}],
            "bufferViews": [view],
            "accessors": [{**accessor, "count": 1, "bufferView": 0}] * 2,
        },
        "negative counts": {
            **base,
            "nodes": [{"mesh": 0}],
            "buffers": [buffer],
            "bufferViews": [{**view, "byteLength": -5}],
            "accessors": [{**accessor, "count": -3, "bufferView": 0}] * 2,
        },
        "a mesh out of range": {**base, "nodes": [{"mesh": 7}]},
        "nothing": {"asset": {"version": "2.0"}},
    }
    return {name: json.dumps(value).encode() for name, value in bombs.items()}


def dae_bomb(levels: int = 30) -> bytes:
    """COLLADA nodes each of which stands twice in the next."""
    nodes = "".join(
        f'<node id="n{k}">' + "".join(f'<instance_node url="#n{k - 1}"/>' for _ in range(2)) + "</node>"
        if k
        else '<node id="n0"><instance_geometry url="#g"/></node>'
        for k in range(levels)
    )
    return (
        '<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset/>'
        '<library_geometries><geometry id="g"><mesh><source id="p"><float_array id="a" count="9">0 0 0 1 0 0 0 1 0'
        '</float_array><technique_common><accessor source="#a" count="3" stride="3"><param name="X" type="float"/>'
        '<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>'
        '<vertices id="v"><input semantic="POSITION" source="#p"/></vertices><triangles count="1"><input offset="0" '
        'semantic="VERTEX" source="#v"/><p>0 1 2</p></triangles></mesh></geometry></library_geometries>'
        f"<library_nodes>{nodes}</library_nodes><library_visual_scenes><visual_scene id='s'>"
        f"<node><instance_node url='#n{levels - 1}'/></node></visual_scene></library_visual_scenes>"
        "<scene><instance_visual_scene url='#s'/></scene></COLLADA>"
    ).encode()


def entities(root: str, levels: int = 12) -> bytes:
    """XML whose entities grow tenfold each (billion laughs), within an element."""
    lines = ['<!ENTITY e0 "lol">'] + [f'<!ENTITY e{k} "{f"&e{k - 1};" * 10}">' for k in range(1, levels)]
    return f'<?xml version="1.0"?><!DOCTYPE x [{"".join(lines)}]><{root}>&e{levels - 1};</{root}>'.encode()


def outside_entity(root: str) -> bytes:
    """XML that asks for a file outside."""
    return f'<?xml version="1.0"?><!DOCTYPE x [<!ENTITY e SYSTEM "file:///etc/passwd">]><{root}>&e;</{root}>'.encode()


def nested(element: str, levels: int = 60_000) -> bytes:
    """XML of very many levels."""
    return (f"<{element}>" * levels + f"</{element}>" * levels).encode()


def npz_bomb(path: Path, names: tuple[str, ...]) -> None:
    """An archive of some megabytes whose arrays have 10^9 entries, all zero."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in names:
            header = b"{'descr': '<f4', 'fortran_order': False, 'shape': (1000000000, 3), }"
            header += b" " * (-(len(header) + 11) % 64) + b"\n"
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                file.write(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header)
                for _ in range(400):
                    file.write(bytes(1 << 20))


def pickled_npz(path: Path, names: tuple[str, ...]) -> None:
    """Arrays of objects, which are pickles."""
    np.savez(path, **{name: np.array([{"a": 1}], dtype=object) for name in names})


def fifo(path: Path) -> None:
    """Put a FIFO that nobody writes to in the place of a file."""
    path.unlink(missing_ok=True)
    os.mkfifo(path)


def device(path: Path) -> None:
    """Put a link to an endless device in the place of a file."""
    path.unlink(missing_ok=True)
    path.symlink_to("/dev/zero")


def folder(path: Path) -> None:
    """Put a folder in the place of a file."""
    path.unlink(missing_ok=True)
    path.mkdir()


def loop(path: Path) -> None:
    """Put a link to itself in the place of a file."""
    path.unlink(missing_ok=True)
    path.symlink_to(path.name)


def mjcf_bombs() -> dict[str, str]:
    """Pieces of MJCF that ask for far more than they say."""
    geom = '<geom type="box" size="0.1 0.1 0.1"/>'
    nested = geom
    for _ in range(6):
        nested = f'<replicate count="40" offset="0.1 0 0">{nested}</replicate>'
    asset = {
        "a height field of 10^9": '<hfield name="h" nrow="30000" ncol="30000" size="1 1 1 1"/>',
        "a height field of 10^18": '<hfield name="h" nrow="1000000000" ncol="1000000000" size="1 1 1 1"/>',
        "a texture of 10^10": '<texture name="t" type="2d" builtin="flat" width="100000" height="100000"/>',
        "a texture of 10^9": '<texture name="t" type="2d" builtin="checker" width="30000" height="30000"/>',
        "a cube texture of 10^9": '<texture name="t" type="cube" builtin="flat" width="20000" height="20000"/>',
        "a mesh made by a wedge of 10^9": '<mesh name="m" builtin="sphere" params="15"/>',
        "a model that is itself": '<model name="self" file="room.xml"/><model name="me" file="rover.xml"/>',
    }
    world = {
        "10^9 copies": f'<replicate count="1000000000" offset="0.1 0 0">{geom}</replicate>',
        "10^5 copies": f'<replicate count="100000" offset="0.1 0 0">{geom}</replicate>',
        "copies of copies": nested,
        "-1 copies": f'<replicate count="-1" offset="0.1 0 0">{geom}</replicate>',
        "a cloth of 10^9": '<flexcomp name="f" type="grid" count="1000 1000 1000" spacing="1 1 1" dim="3"/>',
        "a cable of 10^9": '<composite prefix="c" type="cable" count="1000000000 1 1" size="1"><geom size="1"/>'
        "</composite>",
        "60,000 levels of bodies": "<body>" * 60_000 + "</body>" * 60_000,
        "300 levels of bodies": "<body>" * 300 + geom + "</body>" * 300,
        "numbers that are none": '<geom type="box" size="nan inf 1e308"/>',
        "a box of 10^30 m": '<geom type="box" size="1e30 1e30 1e30"/>',
        "a box at 10^30 m": '<geom type="box" size="1 1 1" pos="1e30 0 0"/>',
        "30,000 boxes": geom * 30_000,
    }
    other = {
        "memory of 10^15": '<size memory="900T"/>',
        "user data of 10^9": '<size nuserdata="2000000000"/>',
        "user numbers of 10^9": '<size nuser_body="2000000000"/>',
        "10^9 contacts": '<size nconmax="2000000000"/>',
        "10^9 constraints": '<size njmax="2000000000"/>',
        "10^9 key frames": '<size nkey="2000000000"/>',
        "a time step of 10^30": '<option timestep="1e30"/>',
        "a time step of 10^-30": '<option timestep="1e-30"/>',
        "an extension": '<extension><plugin plugin="mujoco.elasticity.cable"/><plugin plugin="/tmp/x.so"/></extension>',
        "a script": '<script lang="python">import os</script>',
        "includes itself": '<include file="room.xml"/><include file="rover.xml"/>',
    }
    return {
        **{label: f"<asset>{text}</asset>" for label, text in asset.items()},
        **{label: f"<worldbody>{text}</worldbody>" for label, text in world.items()},
        **other,
    }


def npy(shape: str, kind: str = "<f4") -> bytes:
    """The header of an array of this shape, and a few numbers."""
    header = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}".encode()
    header += b" " * (-(len(header) + 11) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + bytes(4000)


def yaml_bombs() -> dict[str, bytes]:
    """YAML whose aliases grow tenfold each, that names objects, and that is nested."""
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]" for k in range(1, 12)]
    return {
        "aliases that grow": "\n".join(lines).encode(),
        "an object": b"rosbag2_bagfile_information: !!python/object/apply:os.system ['true']\n",
        "deep lists": b"[" * 100_000,
        "an alias of itself": b"rosbag2_bagfile_information: &a\n  version: *a\n  topics_with_message_count: *a\n",
    }


def mcap_bombs() -> dict[str, bytes]:
    """MCAP files whose chunks and counts are far larger than they are."""
    magic = b"\x89MCAP0\r\n"

    def record(kind: int, data: bytes, length: int | None = None) -> bytes:
        return bytes([kind]) + struct.pack("<Q", len(data) if length is None else length) + data

    def text(value: str) -> bytes:
        return struct.pack("<I", len(value)) + value.encode()

    head = magic + record(1, text("ros2") + text("x"))
    footer = record(2, struct.pack("<QQI", 0, 0, 0)) + magic
    packed = lz4_bomb()
    chunk = struct.pack("<QQQI", 0, 10**18, 10**10, 0) + text("lz4") + struct.pack("<Q", len(packed)) + packed
    summary = len(head)
    return {
        "a chunk that unpacks to 10^10": head + record(6, chunk) + footer,
        "a record of 10^18": head + record(6, b"", 10**18) + footer,
        "a summary at 10^18": head + record(2, struct.pack("<QQI", 10**18, 10**18, 0)) + magic,
        "a summary that is itself": head + record(2, struct.pack("<QQI", summary, summary, 0)) + magic,
        "nothing": head + footer,
        "text of 4 GiB": magic + record(1, struct.pack("<I", 0xFFFFFFFF)) + footer,
    }


def lz4_bomb() -> bytes:
    """An LZ4 frame that says it holds 10^10 zeros."""
    head = b"\x04\x22\x4d\x18" + bytes([0x68, 0x70]) + struct.pack("<Q", 10**10) + b"\x00"
    run = b"\x1f\x00\x01\x00" + b"\xff" * 250_000 + b"\x00"
    return head + (struct.pack("<I", len(run)) + run) * 20 + bytes(4)
