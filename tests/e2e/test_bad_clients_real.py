"""Bad clients of a real conductor, over Zenoh: refused, counted, and nobody else is troubled."""

import json

import msgpack
from processes import wait_for

from schemas import SCHEMA_VERSION
from schemas.wire import topics
from schemas.wire.codec import decode
from schemas.wire.control import Reply
from twin.base.errors import UsageError
from twin.fabric.discovery import find_conductor
from twin.fabric.zenoh_bus import open_bus

BAD = {
    "schema version": msgpack.packb({"v": SCHEMA_VERSION + 1, "verb": "status"}),
    "dance": msgpack.packb({"v": SCHEMA_VERSION, "verb": "dance"}),
    "not MessagePack": b"\xc1" * 1000,
    "not a valid message": msgpack.packb(["status"]),
    "100000000 bytes": bytes(100_000_000),
}
"""Part of the reason -> payload."""


def test_bad_clients(marked, tmp_path):
    state = tmp_path / "state"
    server = marked.start("conductor", "serve", "--state", str(state), "--insecure")

    def endpoint():
        try:
            return find_conductor(state).endpoint
        except UsageError:
            return ""

    bus = open_bus("client", connect=[wait_for(endpoint, "the conductor")])
    try:
        for _ in range(3):
            for reason, payload in BAD.items():
                reply = decode(bus.request(topics.RPC_STATUS.key, payload, 30.0), Reply)
                assert reason in reply.error
    finally:
        bus.close()
    status = marked.run(
        *("conductor", "status", "--state", str(state), "--insecure", "--output", "json")
    )
    counters = json.loads(status.stdout)["counters"]
    assert (counters["refused"], counters["turned_away"]) == (12, 3)
    assert counters["faults"] == 0
    server.terminate()
    assert server.wait() == 0
    assert "Traceback" not in server.stderr.read()
