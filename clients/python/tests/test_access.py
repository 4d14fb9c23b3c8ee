"""Keys, roles and TLS: who is let in, and what the others are told."""

from __future__ import annotations

import shutil
import subprocess

import pytest
import scene
from servers import start

import orenx
import orenx.aio

KEYS = {role: f"{role}-0123456789abcdef" for role in ("ingest", "read", "admin")}


@pytest.fixture(scope="module")
def guarded(tmp_path_factory):
    """A server with a key for each role, and a folder."""
    folder = tmp_path_factory.mktemp("keys")
    config = folder / "orenx.toml"
    key = '[[auth.keys]]\nname = "{0}"\nrole = "{0}"\nkey = "{1}"\n'
    config.write_text("".join(key.format(role, secret) for role, secret in KEYS.items()))
    server = start(f"storage.path={folder / 'maps'}", config=config)
    yield server
    server.stop()


def test_a_key_opens_what_its_role_may(guarded):
    def connect(role):
        return orenx.connect(guarded.grpc, api_key=KEYS[role])

    with connect("ingest") as robot:
        assert robot.map().stream_frames(scene.frames(2), "rover").integrated == 2
        with pytest.raises(orenx.PermissionDeniedError):
            robot.map().reset()
    with connect("read") as planner:
        assert planner.map().query_points([0.0, 1.0, 1.5]).epoch > 0
        with pytest.raises(orenx.PermissionDeniedError):
            planner.map().stream_frames(scene.frames(1), "rover")
    with connect("admin") as admin:
        assert admin.map().reset().epoch > 0


BALL = orenx.Sphere([0.0, 0.0, 1.0], 0.3)


def changes(m, folder):
    """Everything that changes maps, or reads what is kept of them."""
    file = folder / "file"
    file.write_bytes(b"no snapshot")
    return {
        "clear": lambda: m.clear(BALL),
        "stamp": lambda: m.stamp(BALL),
        "reset": m.reset,
        "list_snapshots": m.list_snapshots,
        "create_snapshot": lambda: m.create_snapshot("mine"),
        "restore_snapshot": lambda: m.restore_snapshot("mine"),
        "delete_snapshot": lambda: m.delete_snapshot("mine"),
        "download_snapshot": lambda: m.download_snapshot("mine", folder / "new"),
        "upload_snapshot": lambda: m.upload_snapshot("mine", file),
    }


@pytest.mark.parametrize("role", ["ingest", "read"])
async def test_changes_take_the_role_of_administrators(guarded, role, tmp_path):
    with orenx.connect(guarded.grpc, api_key=KEYS["admin"]) as admin:
        before = admin.map().stats().map.epoch
    with orenx.connect(guarded.grpc, api_key=KEYS[role]) as client:
        calls = changes(client.map(), tmp_path) | {
            "create_map": lambda: client.create_map("mine"),
            "delete_map": lambda: client.delete_map("default"),
            "settings": client.settings,
            "set_log_level": lambda: client.set_log_level("info"),
        }
        for name, call in calls.items():
            with pytest.raises(orenx.PermissionDeniedError) as caught:
                call()
            # Who it is, and what it takes.
            said = str(caught.value)
            assert "the role admin" in said, (name, said)
            assert f"'{role}' has {role}" in said, (name, said)
    async with await orenx.aio.connect(guarded.grpc, api_key=KEYS[role]) as client:
        for name, call in changes(client.map(), tmp_path).items():
            with pytest.raises(orenx.PermissionDeniedError, match="the role admin"):
                await call()
            assert not (tmp_path / "new").exists(), name
    with orenx.connect(guarded.grpc, api_key=KEYS["admin"]) as admin:
        assert admin.map().stats().map.epoch == before
        assert admin.map().list_snapshots() == []


def test_an_administrator_edits_and_keeps_maps(guarded, tmp_path):
    with orenx.connect(guarded.grpc, api_key=KEYS["admin"]) as admin:
        m = admin.create_map("yard")
        try:
            stamped = m.stamp(BALL)
            made = m.create_snapshot("with-ball")
            cleared = m.clear(orenx.Sphere([0.0, 0.0, 1.0], 1.0))
            assert cleared.surfels_removed == stamped.surfels_added > 0
            file = m.download_snapshot("with-ball", tmp_path / "yard.orenx")
            assert file.stat().st_size == made.bytes
            m.delete_snapshot("with-ball")
            assert m.upload_snapshot("sent", file).bytes == made.bytes
            restored = m.restore_snapshot("sent")
            answer = m.query_points([[0, 0, 1]], min_epoch=restored.epoch)
            assert answer.occupied[0]
            # Who reads sees it too; who sends frames does not.
            with orenx.connect(guarded.grpc, api_key=KEYS["read"]) as reader:
                assert reader.map("yard").query_points([[0, 0, 1]]).occupied[0]
            with orenx.connect(guarded.grpc, api_key=KEYS["ingest"]) as robot:
                with pytest.raises(orenx.PermissionDeniedError, match="the role read"):
                    robot.map("yard").query_points([[0, 0, 1]])
                assert robot.map("yard").stats().map.map_id == "yard"
        finally:
            admin.delete_map("yard")


async def test_without_a_key_nobody_gets_in(guarded):
    frames = scene.frames(1)
    for key in (None, "not-the-key-that-it-is"):
        with orenx.connect(guarded.grpc, api_key=key) as client:
            with pytest.raises(orenx.UnauthenticatedError):
                client.maps()
            with pytest.raises(orenx.UnauthenticatedError):
                client.map().stream_frames(frames, "rover")
        async with await orenx.aio.connect(guarded.grpc, api_key=key) as client:
            with pytest.raises(orenx.UnauthenticatedError):
                await client.maps()
            # Again and again: what is refused must not depend on who is faster.
            for _ in range(20):
                with pytest.raises(orenx.UnauthenticatedError):
                    await client.map().stream_frames(frames, "rover")


@pytest.fixture(scope="module")
def certificate(tmp_path_factory):
    """An authority (ca.pem), and a certificate of it for 127.0.0.1 (cert.pem, key.pem)."""
    openssl = shutil.which("openssl")
    if openssl is None:
        pytest.skip("skipped: no openssl, to make a certificate")
    folder = tmp_path_factory.mktemp("tls")
    new_key = "-newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes"
    # One of an authority is not taken for a client's own: there are two.
    (folder / "leaf.ext").write_text("basicConstraints=CA:FALSE\nsubjectAltName=IP:127.0.0.1\n")
    for made in (
        f"req -x509 {new_key} -days 1 -subj /CN=authority -keyout ca.key -out ca.pem",
        f"req {new_key} -subj /CN=orenx -keyout key.pem -out leaf.csr",
        "x509 -req -in leaf.csr -CA ca.pem -CAkey ca.key -CAcreateserial -days 1 -extfile leaf.ext"
        " -out cert.pem",
    ):
        subprocess.run([openssl, *made.split()], check=True, capture_output=True, cwd=folder)
    return folder


async def test_tls_is_spoken_with_whom_we_trust(certificate):
    server = start(f"tls.cert={certificate / 'cert.pem'}", f"tls.key={certificate / 'key.pem'}")
    url = "grpcs://" + server.grpc.partition("://")[2]
    try:
        ca = certificate / "ca.pem"
        with orenx.connect(url, ca=ca) as client:
            assert client.map().info().map.map_id == "default"
        async with await orenx.aio.connect(url, ca=ca.read_bytes()) as client:
            assert (await client.map().info()).map.map_id == "default"
        with pytest.raises(orenx.UnavailableError):
            orenx.connect(url, wait_s=0.5)
    finally:
        server.stop()


async def test_mutual_tls_needs_our_certificate_too(certificate):
    ca, cert, key = (certificate / name for name in ("ca.pem", "cert.pem", "key.pem"))
    server = start(f"tls.cert={cert}", f"tls.key={key}", f"tls.client_ca={ca}")
    url = "grpcs://" + server.grpc.partition("://")[2]
    try:
        with orenx.connect(url, ca=ca, cert=cert, key=key) as client:
            assert client.map().info().map.map_id == "default"
        with orenx.connect(url, ca=ca, wait_s=0) as client, pytest.raises(orenx.Error):
            client.map().info(timeout_s=5)
    finally:
        server.stop()
