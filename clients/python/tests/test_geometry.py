"""Poses, cameras and URLs."""

from __future__ import annotations

import numpy as np
import pytest

import orenx
from orenx import geometry
from orenx.address import Access, Grpc, Zenoh, read_url


def rotations(count: int) -> np.ndarray:
    q = np.random.default_rng(3).normal(size=(count, 4))
    special = [
        [1, 0, 0, 0],
        [0, 1, 0, 0],
        [0, 0, 1, 0],
        [0, 0, 0, 1],
        [1, 1, 0, 0],
        [0, 1, 1, 1e-9],
    ]
    q = np.concatenate([q, special])
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def test_rotations_go_both_ways():
    q = rotations(200)
    matrices = geometry.rotation_of(q)
    np.testing.assert_allclose(
        np.einsum("nij,nkj->nik", matrices, matrices), np.eye(3)[None].repeat(len(q), 0), atol=1e-12
    )
    back = geometry.quaternion_of(matrices)
    same = np.abs((back * q).sum(axis=1))
    np.testing.assert_allclose(same, 1, atol=1e-9)


def test_a_quarter_turn_about_z_turns_x_into_y():
    half = np.sqrt(0.5)
    np.testing.assert_allclose(
        geometry.rotation_of([0, 0, half, half]) @ [1, 0, 0], [0, 1, 0], atol=1e-12
    )


def test_poses_go_both_ways():
    matrix = orenx.look_at([1, 2, 3], [0, 0, 1])
    np.testing.assert_allclose(
        geometry.pose(geometry.pose_to_wire("pose", matrix)), matrix, atol=1e-12
    )
    flat = geometry.poses_flat("pose", matrix)
    np.testing.assert_allclose(
        geometry.pose(geometry.pose_to_wire("pose", flat)), matrix, atol=1e-12
    )


def test_a_camera_that_looks_at_something_has_it_in_its_middle_and_up_is_up():
    for eye, target in (([1, 2, 3], [0, 0, 1]), ([0, 0, 2], [0, 0, 0])):
        camera_from_world = np.linalg.inv(orenx.look_at(eye, target))
        x, y, z, _ = camera_from_world @ [*target, 1]
        assert abs(x) < 1e-9
        assert abs(y) < 1e-9
        assert z > 0
    assert (np.linalg.inv(orenx.look_at([1, 2, 3], [0, 0, 1])) @ [0, 0, 1.5, 1])[1] < 0


def test_cameras_of_a_field_of_view():
    camera = orenx.Intrinsics.of_fov(640, 480, 90)
    assert camera.fx == pytest.approx(320)
    assert orenx.Intrinsics.of_matrix(camera.matrix, 640, 480) == camera


@pytest.mark.parametrize(
    ("url", "address"),
    [
        ("grpc://robot:7610", Grpc("robot:7610", False)),
        ("grpcs://[::1]:1/", Grpc("[::1]:1", True)),
        ("zenoh+tcp://robot:7447", Zenoh("tcp/robot:7447", None, "orenx")),
        ("zenoh+tls://[::1]:1/a/b/", Zenoh("tls/[::1]:1", None, "a/b")),
        ("zenoh+file:/etc/my.json5#fleet", Zenoh(None, "/etc/my.json5", "fleet")),
    ],
)
def test_urls_are_read(url, address):
    assert read_url(url) == address


@pytest.mark.parametrize(
    "url", ["", "robot:7610", "grpc://", "grpc://a/b", "zenoh+quic://a:1", "zenoh+file:"]
)
def test_other_urls_are_refused(url):
    with pytest.raises(orenx.InvalidArgumentError, match="url"):
        read_url(url)


def test_keys_and_certificates_go_where_they_belong(tmp_path):
    assert Access(api_key="k").metadata() == (("api-key", "k"),)
    assert Access().metadata() == ()
    with pytest.raises(orenx.InvalidArgumentError, match="grpcs"):
        orenx.connect("grpc://127.0.0.1:1", ca=b"PEM", wait_s=0)
    with pytest.raises(orenx.InvalidArgumentError, match="cert"):
        orenx.connect("grpcs://127.0.0.1:1", cert=b"PEM", wait_s=0)
    with pytest.raises(orenx.InvalidArgumentError, match="ca"):
        orenx.connect("grpcs://127.0.0.1:1", ca=tmp_path / "none.pem", wait_s=0)
