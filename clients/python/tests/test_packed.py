"""Packed numbers, held against protobuf itself."""

from __future__ import annotations

import numpy as np
import pytest
from google.protobuf.message import DecodeError

from orenx import packed
from orenx.v1 import query_pb2

Request, Reply = query_pb2.QueryPointsRequest, query_pb2.QueryPointsReply
DISTANCE, GRADIENT = Reply.DISTANCE_M_FIELD_NUMBER, Reply.GRADIENT_FIELD_NUMBER


@pytest.mark.parametrize("count", [0, 1, 42, 43, 5462, 300_000])
def test_what_is_written_is_what_protobuf_reads(count):
    numbers = np.random.default_rng(count).normal(size=(count, 3)).astype(np.float32)
    data = packed.write(
        Request(map_id="default", max_age_ms=9), [(Request.POINTS_M_FIELD_NUMBER, numbers)]
    )
    message = Request.FromString(data)
    assert (message.map_id, message.max_age_ms) == ("default", 9)
    np.testing.assert_array_equal(np.array(message.points_m, np.float32), numbers.ravel())


@pytest.mark.parametrize("count", [0, 1, 31, 100_000])
def test_what_protobuf_writes_is_split(count):
    numbers = np.random.default_rng(count).normal(size=count).astype(np.float32)
    reply = Reply(
        distance_m=numbers, gradient=np.repeat(numbers, 3), state=b"\x01" * count, epoch=7
    )
    columns, rest = packed.split(reply.SerializeToString(), [DISTANCE, GRADIENT])
    np.testing.assert_array_equal(columns.get(DISTANCE, np.zeros(0, np.float32)), numbers)
    assert len(columns.get(GRADIENT, [])) == 3 * count
    left = Reply.FromString(rest)
    assert (len(left.state), left.epoch, len(left.distance_m)) == (count, 7, 0)


def test_pieces_and_single_numbers_of_a_field_are_one_column():
    one = packed.write(Reply(epoch=1), [(DISTANCE, np.array([1, 2], np.float32))])
    single = bytes([DISTANCE << 3 | 5]) + np.float32(3).tobytes()
    columns, rest = packed.split(one + single + Reply(server_us=4).SerializeToString(), [DISTANCE])
    np.testing.assert_array_equal(columns[DISTANCE], [1, 2, 3])
    assert Reply.FromString(rest).server_us == 4


def test_broken_messages_are_refused():
    whole = packed.write(Reply(epoch=300), [(DISTANCE, np.ones(40, np.float32))])
    for end in range(1, len(whole)):
        try:
            columns, _ = packed.split(whole[:end], [DISTANCE])
        except DecodeError:
            continue
        assert DISTANCE not in columns  # cut between two fields
    for broken in (b"\x0b", b"\x0a\x03abc", b"\xff" * 11, b"\x0a\xff\xff\xff\xff\x0f"):
        with pytest.raises(DecodeError):
            packed.split(broken, [DISTANCE])
