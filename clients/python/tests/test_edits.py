"""What is forgotten, and what is put in by hand."""

from __future__ import annotations

import numpy as np
import pytest
import scene

import orenx
import orenx.aio

FRAMES = scene.frames(12)


@pytest.fixture
def room(client):
    m = client.create_map("edited")
    m.stream_frames(FRAMES, "rover")
    yield m
    client.delete_map("edited")


REGION = [[-0.5, 0.7, 0.7], [0.5, 1.7, 1.7]]


@pytest.mark.parametrize("kind", ["box", "corners", "sphere"])
def test_what_is_cleared_is_unknown(room, kind):
    point = [[0.0, 1.2, 1.2]]
    assert room.query_points(point).free[0]
    region = {
        "box": orenx.Box(*np.array(REGION)),
        "corners": REGION,
        "sphere": orenx.Sphere([0.0, 1.2, 1.2], 0.5),
    }[kind]
    done = room.clear(region)
    assert done.cells_forgotten > 0
    assert room.query_points(point, min_epoch=done.epoch).unknown[0]


def test_what_one_robot_saw_is_cleared(room):
    # Only what all of the conditions name.
    elsewhere = room.clear([[50, 50, 50], [51, 51, 51]], robot_id="rover")
    assert elsewhere.surfels_removed == 0
    assert room.clear(older_than_ns=FRAMES[0].stamp_ns).surfels_removed == 0
    before = room.stats().numbers["surfels"]
    assert room.clear(robot_id="rover").surfels_removed == before > 0
    with pytest.raises(orenx.NotFoundError):
        room.clear(robot_id="nobody")
    with pytest.raises(orenx.InvalidArgumentError) as caught:
        room.clear()
    assert caught.value.field == "clear"


def cube(middle, edge):
    """A closed mesh."""
    bits = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    faces = [[0, 2, 1], [1, 2, 3], [4, 5, 6], [5, 7, 6], [0, 1, 4], [1, 5, 4]]
    faces += [[2, 6, 3], [3, 6, 7], [0, 4, 2], [2, 4, 6], [1, 3, 5], [3, 7, 5]]
    return orenx.Mesh((bits - 0.5) * edge + middle, faces)


def solid(kind, middle):
    pose = np.eye(4)
    pose[:3, 3] = middle
    return {
        "box": orenx.SolidBox(pose, [0.4, 0.4, 0.4]),
        "sphere": orenx.Sphere(middle, 0.2),
        "mesh": cube(middle, 0.4),
    }[kind]


@pytest.mark.parametrize("kind", ["box", "sphere", "mesh"])
def test_what_is_stamped_is_there_until_it_is_cleared(room, kind):
    middle = np.array([0.8, 0.9, 1.2])
    beside, surface = middle - [0.5, 0, 0], middle - [0.2, 0, 0]
    done = room.stamp(solid(kind, middle), robot_id="architect", color=[1, 0, 0])
    assert done.surfels_added > 0
    assert done.cells_told > 0
    fields = ["distance", "state", "color"]
    answer = room.query_points([middle, beside, surface], fields=fields, min_epoch=done.epoch)
    assert answer.occupied[0]
    assert answer.distance[1] == pytest.approx(0.3, abs=0.04)
    assert answer.color[2] == pytest.approx([1, 0, 0], abs=0.1)
    gone = room.clear(robot_id="architect")
    assert gone.surfels_removed == done.surfels_added
    assert not room.query_points([middle], min_epoch=gone.epoch).occupied[0]


def test_space_is_told_free(room):
    middle = np.array([20.0, 20.0, 1.0])
    assert room.query_points([middle]).unknown[0]
    done = room.stamp(solid("sphere", middle), mode="free")
    assert done.surfels_added == 0
    assert room.query_points([middle], min_epoch=done.epoch).free[0]


@pytest.mark.parametrize(
    ("given", "field"),
    [
        ({"solid": "box"}, "solid"),
        ({"solid": orenx.Sphere([0, 0, 0], -1.0)}, "sphere.radius_m"),
        ({"solid": orenx.Sphere([0, 0], 1.0)}, "sphere.center"),
        ({"solid": orenx.SolidBox(np.eye(3), [1, 1, 1])}, "box.world_from_box"),
        ({"solid": orenx.Mesh(np.zeros((3, 3)), [[0, 1, 3]])}, "mesh.triangles"),
        ({"solid": orenx.Mesh(np.zeros((3, 3)), [[0, 1, -1]])}, "mesh.triangles"),
        ({"solid": orenx.Mesh(np.zeros((3, 3)), [[0.0, 1.0, 2.0]])}, "mesh.triangles"),
        ({"solid": orenx.Sphere([0, 0, 0], 1.0), "mode": "melt"}, "mode"),
        ({"solid": orenx.Sphere([0, 0, 0], 1.0), "color": [1, 0]}, "color"),
        ({"solid": orenx.Sphere([0, 0, 0], 1.0), "color": [2, 0, 0]}, "color"),
    ],
)
def test_what_cannot_be_stamped_is_refused_by_name(client, given, field):
    with pytest.raises(orenx.InvalidArgumentError) as caught:
        client.map().stamp(**given)
    assert caught.value.field == field


async def test_the_loop_edits_too(server):
    async with await orenx.aio.connect(server.grpc) as client:
        m = await client.create_map("edited-aio")
        try:
            done = await m.stamp(orenx.Sphere([0, 0, 1], 0.3))
            answer = await m.query_points([[0, 0, 1]], min_epoch=done.epoch)
            assert answer.occupied[0]
            gone = await m.clear(orenx.Sphere([0, 0, 1], 1.0))
            assert gone.surfels_removed == done.surfels_added > 0
        finally:
            await client.delete_map("edited-aio")
