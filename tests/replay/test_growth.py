from dataclasses import replace

import numpy as np
import trimesh

from anm_mj.io.read_run import read_run
from anm_mj.replay.surface import first_seen, growing_mesh, merged, without_shards
from tests.box_room import ROOM_HIGH_M, ROOM_LOW_M, room


def test_a_wall_appears_when_the_camera_turns_to_it(run_folder):
    run = read_run(run_folder)
    # The robot looks along x first and turns left: east, north, west wall.
    points = np.array([[2.0, 0.2, 1.2], [0.2, 1.5, 1.2], [-2.0, 0.2, 1.2]])
    east, north, west = first_seen(run, points)
    assert east == 0
    yaw = np.degrees([run.frames[k].pose.yaw_rad for k in (north, west)])
    # It comes into view at 45 degrees from the axis of a camera with 90 degrees.
    assert 25.0 < yaw[0] < 60.0
    assert 115.0 < yaw[1] < 160.0


def test_a_lost_camera_has_seen_nothing(run_folder):
    run = read_run(run_folder)
    lost = replace(run, frames=tuple(replace(frame, is_lost=frame.step < 3) for frame in run.frames))
    assert first_seen(lost, np.array([[2.0, 0.2, 1.2]])).tolist() == [3]


def test_what_no_frame_saw_appears_with_its_neighbour(run_folder):
    hidden = np.array([[2.0, 0.2, 1.2], [2.4, 0.2, 1.2]])
    assert first_seen(read_run(run_folder), hidden).tolist() == [0, 0]


def test_faces_stand_in_the_order_in_which_they_were_seen(run_folder):
    mesh = growing_mesh(read_run(run_folder))
    assert mesh is not None
    assert (np.diff(mesh.face_count) >= 0).all()
    assert 0 < mesh.face_count[0] < mesh.face_count[-1] == len(mesh.faces)
    for frame in (0, 10, 30):
        shown = mesh.faces[: mesh.face_count[frame]]
        assert mesh.first_frame[shown].max() <= frame
    assert mesh.vertices_m[:, 2].max() <= 2.0


def test_merging_keeps_the_surface():
    mesh = room().subdivide_loop(0)
    for _ in range(6):
        mesh = mesh.subdivide()
    rgb = np.full((len(mesh.vertices), 3), 90, np.uint8)
    vertices, faces, colour = merged(np.asarray(mesh.vertices), np.asarray(mesh.faces), rgb, 0.2)
    assert len(faces) < len(mesh.faces) / 3
    assert (colour == 90).all()
    assert np.abs(np.minimum(vertices - ROOM_LOW_M, ROOM_HIGH_M - vertices).min(axis=1)).max() < 0.11
    assert (vertices.min(axis=0) >= ROOM_LOW_M - 1e-9).all()


def test_what_a_former_run_saw_is_there_from_the_start(run_folder):
    run = read_run(run_folder)
    hidden = np.array([[50.0, 50.0, 50.0], [1.0, 0.0, 1.0]])
    continued = replace(run, manifest={**run.manifest, "continued_from": {"run": "former"}})
    assert first_seen(continued, hidden)[0] == 0


def test_glimpses_through_windows_are_left_out():
    room = trimesh.creation.box((4.0, 4.0, 2.0)).subdivide_to_size(0.4)
    shard, cup = trimesh.creation.box((0.3, 0.3, 0.3)), trimesh.creation.box((0.1, 0.1, 0.1))
    shard.apply_translation((4.0, 0.0, 0.0))
    whole = trimesh.util.concatenate([room, shard, cup])
    kept = without_shards(whole.vertices, whole.faces)
    np.testing.assert_array_equal(kept, np.repeat([True, False, True], [len(room.faces), 12, 12]))
    # Nothing is stray where there is nothing large.
    assert without_shards(shard.vertices, shard.faces).all()
