"""What a schema cannot say about a question: raw bodies are whole points of finite numbers, and a
distance for unknown points needs a policy that uses it."""

import struct

import schemathesis
from hypothesis import strategies as st

number = st.floats(width=32, allow_nan=False, allow_infinity=False)
points = st.lists(st.tuples(number, number, number), max_size=20)


raw = points.map(lambda rows: b"".join(struct.pack("<3f", *row) for row in rows))
schemathesis.openapi.media_type("application/octet-stream", raw)

POLICIES = ("free", "occupied")


@schemathesis.hook
def filter_case(context, case):
    """In the query string the policy is a key of its own; the body's own keys go before it."""
    query = case.query or {}
    body = case.body if isinstance(case.body, dict) else {}
    options = {**query, **{key: value for key, value in body.items() if value is not None}}
    return "unknown_distance_m" not in options or options.get("unknown_policy") in POLICIES
