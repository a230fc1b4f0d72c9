"""A simulator's end of a rig whose stack sends one message of SIZE bytes; prints what came of it.

``python giant_messages.py SIZE BESIDE SOCKET``; with BESIDE it answers the tick as well, with
SOCKET it comes through the socket of a rig's folder.
"""

import json
import subprocess
import sys
from pathlib import Path

import psutil

from schemas.messages import Tick
from twin.base.errors import InfrastructureError
from twin.fabric.drive import STACK_BYTES_MAX, SimulatorEnd
from twin.fabric.rig_folder import RigFolder
from twin.fabric.zenoh_bus import open_bus

STACK = """
import json, queue, sys, msgpack, zenoh
endpoint, size, beside = sys.argv[1], int(sys.argv[2]), sys.argv[3] == "True"
config = zenoh.Config()
for key, value in {
    "mode": "peer", "connect/endpoints": [endpoint], "namespace": "giants",
    "scouting/multicast/enabled": False, "transport/shared_memory/enabled": False,
}.items():
    config.insert_json5(key, json.dumps(value))
session = zenoh.open(config)
say = lambda key, data: session.put(key, data, congestion_control=zenoh.CongestionControl.BLOCK)
ticks = queue.SimpleQueue()
keep = zenoh.handlers.Callback(lambda s: ticks.put(s.payload.to_bytes()), indirect=False)
session.declare_subscriber("drive/r/tick", keep)
ready = {"v": 1, "role": "stack", "rig": "r", "slots": 1, "seen": True}
say("drive/r/control/stack", msgpack.packb(ready))
while True:
    seq = msgpack.unpackb(ticks.get())["seq"]
    if seq == 3:
        say("drive/r/command", bytes(size))
    if seq != 3 or beside:
        say("drive/r/command", msgpack.packb({"v": 1, "seq": seq, "commands": []}))
"""


def main(size: int, beside: bool, socket: bool) -> None:
    """Exchange ticks until there is a reason to end; growth is that of this process's memory."""
    folder = RigFolder()
    bus = open_bus(
        "peer",
        listen=[folder.drive if socket else "tcp/127.0.0.1:0"],
        namespace="giants",
        message_bytes_max=STACK_BYTES_MAX,
    )
    end = SimulatorEnd(bus, "r", 1, None)
    words = [sys.executable, "-c", STACK, bus.endpoints[0], str(size), str(beside)]
    child = subprocess.Popen(words)

    def wait() -> None:
        if child.poll() is not None:
            raise InfrastructureError("the stack ended")

    try:
        end.handshake(wait)
        before = psutil.Process().memory_info().rss
        reason, seq = "", 0
        while not reason:
            try:
                end.exchange(seq, Tick(1, seq, [True], [1], [seq], [0], [], 0), [], [], wait)
                seq += 1
            except InfrastructureError as error:
                reason = str(error)
        growth = _peak_bytes() - before
    finally:
        child.kill()
        child.wait()
        bus.close()
        folder.close()
    print(json.dumps({"reason": reason, "growth": growth}))


def _peak_bytes() -> int:
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(1024 * int(line.split()[1]) for line in lines if line.startswith("VmHWM"))


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2] == "beside", sys.argv[3] == "socket")
