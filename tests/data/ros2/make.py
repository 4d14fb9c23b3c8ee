"""Writes the golden payloads beside it: ROS 2 messages in CDR (OMG 9.3) and rmw_zenoh's attachments.

Nothing of orenx is used. Run in this folder: python3 make.py. `name.le.bin` is CDR_LE, `name.be.bin`
CDR_BE; src/wire/ros2/golden.rs has the same values."""

import struct
from pathlib import Path


class Cdr:
    """Appends primitives, each aligned to its size, counted from behind the header."""

    def __init__(self, order):
        self.order, self.body = order, b""

    def number(self, code, *values):
        size = struct.calcsize(code)
        for value in values:
            self.body += b"\0" * (-len(self.body) % size)
            self.body += struct.pack(self.order + code, value)
        return self

    def string(self, text):
        data = text.encode() + b"\0"
        self.number("I", len(data)).body += data
        return self

    def octets(self, data):
        self.number("I", len(data)).body += bytes(data)
        return self

    def header(self, frame="camera"):
        return self.number("i", 1700000000).number("I", 123456789).string(frame)

    def bytes(self):
        return bytes([0, self.order == "<", 0, 0]) + self.body


def text(c):
    c.string("a chair by the window")


def image(c):
    c.header().number("I", 2, 3).string("16UC1").number("B", 0).number("I", 6).octets(range(12))


def compressed_image(c):
    c.header("front").string("jpeg").octets(b"\xff\xd8\xff\xe0orenx")


def camera_info(c):
    c.header().number("I", 480, 640).string("plumb_bob")
    c.number("I", 5).number("d", 0.125, -0.25, 0.0, 0.001, 0.5)
    c.number("d", 600.5, 0, 320.25, 0, 601.5, 240.75, 0, 0, 1)
    c.number("d", 1, 0, 0, 0, 1, 0, 0, 0, 1)
    c.number("d", 599, 0, 321, 0, 0, 598, 241, 0, 0, 0, 1, 0)
    c.number("I", 1, 1).number("I", 2, 4, 476, 636).number("?", True)


def point_cloud(c):
    c.header("map").number("I", 1, 2).number("I", 4)
    for name, offset, kind in [("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("rgb", 12, 6)]:
        c.string(name).number("I", offset).number("B", kind).number("I", 1)
    c.number("?", False).number("I", 16, 32).octets(range(32)).number("?", True)


def pose_stamped(c):
    c.header("map").number("d", 1.5, -2.25, 0.125).number("d", 0, 0, 0.6, 0.8)


def transform_stamped(c, parent="map", child="base_link"):
    c.header(parent).string(child).number("d", 1.5, -2.25, 0.125).number("d", 0, 0, 0.6, 0.8)


def tf_message(c):
    c.number("I", 2)
    transform_stamped(c)
    transform_stamped(c, "base_link", "camera_optical")


def occupancy_grid(c):
    c.header("map").number("i", 1600000000).number("I", 5).number("f", 0.05).number("I", 3, 2)
    c.number("d", -1.5, 2.5, 0.25).number("d", 0, 0, 0, 1)
    c.octets(struct.pack("6b", -1, 0, 50, 100, 1, -1))


def distance_slice(c):
    c.header("map").number("f", 0.05).number("I", 2, 2).number("d", -1.5, 2.5, 0.25)
    c.number("f", -1000).number("I", 4).number("f", 0.5, -0.125, -1000, 2)


def esdf_request(c):
    c.number("?", True, False, True).string("map").number("d", -1, -2, 0.25).number("d", 2, 1.5, 1)
    c.number("I", 1).number("d", 0.5, 0.5, 0.5).number("I", 1).number("d", 0.1, 0.2, 0.3)
    c.number("I", 1).number("d", 3, 2, 1).number("I", 1).number("f", 0.125)


def esdf_response(c):
    c.header("map").number("d", -1, -2, 0.25).number("f", 0.05).number("I", 3)
    for label, size, stride in [("x", 1, 4), ("y", 2, 4), ("z", 2, 2)]:
        c.string(label).number("I", size, stride)
    c.number("I", 0).number("I", 4).number("f", 0.5, -0.125, -1000, 2).number("?", True)


def main():
    here = Path(__file__).parent
    for write in [
        text, image, compressed_image, camera_info, point_cloud, pose_stamped, transform_stamped,
        tf_message, occupancy_grid, distance_slice, esdf_request, esdf_response,
    ]:
        for order, end in [("<", "le"), (">", "be")]:
            cdr = Cdr(order)
            write(cdr)
            (here / f"{write.__name__}.{end}.bin").write_bytes(cdr.bytes())
    gid = bytes(range(16, 32))
    number, stamp = struct.pack("<q", 42), struct.pack("<q", 1700000000123456789)
    (here / "attachment.bin").write_bytes(number + stamp + bytes([16]) + gid)
    name = lambda text: bytes([len(text)]) + text.encode()
    (here / "attachment.named.bin").write_bytes(
        name("sequence_number") + number + name("source_timestamp") + stamp
        + name("source_gid") + bytes([16]) + gid
    )


if __name__ == "__main__":
    main()
