"""Every verb against the real server, over gRPC and Zenoh, held against the room's own truth."""

from __future__ import annotations

import numpy as np
import pytest
import scene
from servers import needs_encoder

import orenx

SCENE = scene.Scene()
CAMERA = orenx.Intrinsics.of_fov(96, 72, 75)


def inside(count: int) -> np.ndarray:
    """Points of the room that are well away from what stands in it."""
    random = np.random.default_rng(1)
    points = random.uniform([-2.3, -1.8, 0.2], [2.3, 1.8, 1.8], (count * 4, 3))
    return points[SCENE.distance(points) > 0.15][:count]


def test_points_are_as_far_as_they_truly_are(default):
    points = inside(500)
    answer = default.query_points(points)
    assert answer.epoch > 0
    assert answer.state.dtype == np.uint8
    assert answer.distance.dtype == np.float32
    assert answer.gradient.shape == (500, 3)
    known = answer.free
    assert known.mean() > 0.9, known.mean()
    off = np.abs(answer.distance[known] - SCENE.distance(points)[known])
    assert np.median(off) < 0.02, np.median(off)
    assert np.isnan(answer.distance[answer.unknown]).all()
    answer.distance[:] = 0  # the caller's own


def test_only_what_is_asked_for_is_there(default):
    answer = default.query_points([0.0, 1.0, 1.5], fields=["distance"])
    assert answer.distance.shape == (1,)
    assert answer.gradient is None
    assert answer.state is None
    with pytest.raises(ValueError, match="state"):
        _ = answer.free


def test_what_nobody_saw_is_what_the_question_wants_it_to_be(default):
    far = [[50.0, 50.0, 50.0]]
    assert np.isnan(default.query_points(far).distance[0])
    free = default.query_points(far, unknown="free", unknown_distance_m=3.0)
    assert free.distance[0] == 3.0
    assert free.unknown[0]
    assert default.query_points(far, unknown="occupied", unknown_distance_m=3.0).distance[0] == -3.0


def test_colors_are_those_of_the_room(default):
    answer = default.query_points([[0.0, -0.3, 0.76], [-1.59, 0.0, 0.4]], fields=["color", "state"])
    for color, id_ in zip(answer.color, (4, 5)):
        assert np.abs(color * 255 - scene.COLORS[id_]).max() < 30, color


def test_spheres_are_points_less_their_radius(default):
    points = inside(200)
    spheres = np.concatenate([points, np.full((200, 1), 0.1)], axis=1)
    by_spheres, by_points = default.query_spheres(spheres), default.query_points(points)
    np.testing.assert_allclose(by_spheres.clearance, by_points.distance - 0.1, atol=1e-5)
    np.testing.assert_array_equal(by_spheres.state, by_points.state)
    np.testing.assert_allclose(by_spheres.gradient, by_points.gradient, atol=1e-5)


def test_a_path_through_the_table_hits_it_and_one_around_is_safe(default):
    through = [[0.0, -1.6, 0.5, 0, 0, 0, 1], [0.0, 1.3, 0.5, 0, 0, 0, 1]]
    around = [
        [1.2, -1.4, 1.2, 0, 0, 0, 1],
        [1.2, 1.2, 1.2, 0, 0, 0, 1],
        [0.0, 1.2, 1.2, 0, 0, 0, 1],
    ]
    answer = default.check_trajectories([[0, 0, 0, 0.15]], [through, around], swept=True)
    hit, safe = answer.trajectories
    assert hit.first_hit is not None
    assert 0 < hit.first_hit.fraction < 1
    assert safe.first_hit is None
    assert answer.min_clearance[0] < 0 < answer.min_clearance[1]
    # Matrices and arrays say the same.
    matrices = np.stack([np.eye(4), np.eye(4)])
    matrices[:, :3, 3] = np.array(through)[:, :3]
    again = default.check_trajectories([[0, 0, 0, 0.15]], matrices, swept=True)
    assert again.trajectories[0].first_hit == hit.first_hit


def test_rays_meet_the_wall_where_it_is(default):
    answer = default.cast_rays([0.0, 1.2, 1.2], [[1, 0, 0], [-2, 0, 0], [0, 1, 0]], max_range_m=8)
    assert answer.hit.all(), answer
    np.testing.assert_allclose(answer.distance, [2.5, 2.5, 0.8], atol=0.03)
    np.testing.assert_allclose(answer.normal[0], [-1, 0, 0], atol=0.3)


def test_the_nearest_surface_is_the_nearest(default):
    answer = default.nearest([[0.0, -0.3, 1.0]], max_unknown_m=0.5)
    np.testing.assert_allclose(answer.distance, [0.25], atol=0.02)
    np.testing.assert_allclose(answer.surface[0], [0.0, -0.3, 0.75], atol=0.04)
    assert answer.unknown_distance.shape == (1,)


def test_a_grid_says_what_points_say(default):
    grid = default.grid(
        [[-1, -1.5, 0.9], [1.2, 1.5, 1.4]], 0.1, fields=["distance", "gradient", "state"]
    )
    assert grid.shape == (22, 30, 5)
    points = default.query_points(grid.centers.reshape(-1, 3))
    np.testing.assert_array_equal(grid["state"].ravel(), points.state)
    np.testing.assert_allclose(grid["distance"].ravel(), points.distance, atol=1e-4)
    np.testing.assert_allclose(grid["gradient"].reshape(-1, 3), points.gradient, atol=1e-3)
    half = default.grid([[-1, -1.5, 0.9], [1.2, 1.5, 1.4]], 0.1, half=True)
    assert half["distance"].dtype == np.float16
    np.testing.assert_allclose(half["distance"], grid["distance"], atol=2e-3)


def test_a_slice_lies_where_its_extent_says(default):
    answer = default.slice(1.2, resolution_m=0.1, region=[[-2, -1, 0], [2, 1, 0]])
    assert answer.distance.shape == (40, 20)
    assert answer.extent == pytest.approx((-2, 2, -1, 1))
    at = default.query_points([[-2 + 5.5 * 0.1, -1 + 3.5 * 0.1, 1.2]])
    np.testing.assert_allclose(answer.distance[5, 3], at.distance[0], atol=1e-4)
    costs = default.slice(0.2, z_max_m=0.7, resolution_m=0.1, costs=(0.2, 0.5))
    assert costs.distance is None
    assert costs.cost.min() >= -1
    assert costs.cost.max() == 100


def test_an_image_shows_what_the_camera_would_see(default):
    pose = orenx.look_at([1.2, 1.2, 1.5], [0, -0.3, 0.6])
    answer = default.render(
        pose, CAMERA, outputs=["color", "depth", "normal", "opacity", "unknown"]
    )
    assert answer.size == (96, 72)
    assert answer["color"].shape == (72, 96, 3)
    assert answer["color"].dtype == np.uint8
    assert answer["unknown"].dtype == np.bool_
    assert answer["normal"].shape == (72, 96, 3)
    truth, _ = SCENE.look(pose, CAMERA)
    seen = answer["depth"] > 0
    assert seen.mean() > 0.9
    assert np.median(np.abs(answer["depth"] - truth)[seen]) < 0.03


def test_words_find_things(default):
    needs_encoder()
    sofa = default.ask("sofa").best
    assert sofa is not None
    assert np.abs(sofa.centroid - [-1.95, -0.2, 0.5]).max() < 0.5, sofa
    assert sofa.best_view is not None
    assert default.ask("sofa", places=True, min_score=0.5).places.shape[1] == 3
    scores = default.query_points([[-1.6, 0.0, 0.5], [0.0, -0.3, 0.75]], text="sofa").text_score
    assert scores[0] > scores[1]
    names = ["table", "sofa", "refrigerator"]
    classes = default.classify([[0.0, -0.3, 0.75], [-1.6, 0.0, 0.5], [40, 0, 0]], names)
    np.testing.assert_array_equal(classes.class_index, [0, 1, -1])
    heat = default.render(
        orenx.look_at([1, 1, 1.5], [0, 0, 0.5]), CAMERA, outputs=["heat"], text="table"
    )
    assert np.nanmax(heat["heat"]) > 0.5
    encoders = default.encoders()
    assert encoders.map == encoders.server
    vector = np.ones(encoders.map.dimension)
    assert (
        default.ask_embedding(encoders.map.encoder_id, vector, top_k=1).encoder_id
        == encoders.map.encoder_id
    )


def test_the_map_tells_of_itself(default):
    info = default.info()
    assert info.map.map_id == "default"
    assert "sdf" in info.map.modalities
    assert info.settings["r0_m"] == pytest.approx(0.1)
    low, high = info.map.bounds
    assert (low < [-2.3, -1.8, 0.1]).all()
    assert (high > [2.3, 1.8, 2.2]).all()
    stats = default.stats()
    assert stats.numbers["frames"] >= 24
    assert stats.counts.integrated >= 24
    rover = next(robot for robot in stats.robots if robot.robot_id == "rover")
    assert rover.intrinsics == scene.CAMERA
    np.testing.assert_allclose(rover.world_from_camera, scene.tour(24)[-1], atol=1e-6)


@pytest.mark.parametrize(
    ("ask", "field"),
    [
        (lambda m: m.query_points([[1, 2]]), "points"),
        (lambda m: m.query_points([["a", "b", "c"]]), "points"),
        (lambda m: m.query_points([[np.nan, 0, 0]]), "points_m[0].x"),
        (lambda m: m.query_points([[0, 0, 0]], fields=["distanz"]), "fields"),
        (lambda m: m.query_points([[0, 0, 0]], unknown="maybe"), "unknown"),
        (lambda m: m.query_spheres([[0, 0, 0, -1]]), "spheres_m[0].r"),
        (lambda m: m.check_trajectories([[0, 0, 0, 1]], np.zeros((2, 6))), "trajectories"),
        (lambda m: m.grid([[0, 0, 0], [1, 1, 1]], 0.0), "voxel_m"),
        (lambda m: m.render(np.zeros((4, 4)), CAMERA), "world_from_camera"),
        (lambda m: m.render(np.eye(4), CAMERA, outputs="color"), "outputs"),
    ],
)
def test_what_is_wrong_is_named(default, ask, field):
    with pytest.raises(orenx.InvalidArgumentError) as caught:
        ask(default)
    assert caught.value.code == "INVALID_ARGUMENT"
    assert caught.value.field == field, caught.value
    assert field in caught.value.message


def test_errors_are_of_their_kind(default):
    with pytest.raises(orenx.FailedPreconditionError):
        default.query_points([[0, 0, 0]], min_epoch=1 << 40)
    with pytest.raises(TypeError, match="max_age"):
        default.query_points([[0, 0, 0]], max_age=1)


def test_a_map_that_is_not_there_is_not_found(client):
    with pytest.raises(orenx.NotFoundError, match="attic"):
        client.map("attic").info()


def test_nobody_there_is_said_within_the_time_given():
    with pytest.raises(orenx.UnavailableError):
        orenx.connect("grpc://127.0.0.1:1", wait_s=0.5)
    with pytest.raises(orenx.InvalidArgumentError, match="url"):
        orenx.connect("http://127.0.0.1:7611")
