"""A stack that writes down all that reaches it: its command line, its environment, and every
message on any key that it can think of. It drives straight on.

``python spying_stack.py FILE``; each entry is a length-prefixed MessagePack map.
"""

import json
import os
import queue
import struct
import sys
from pathlib import Path

import msgpack
import zenoh

RIG = os.environ["TWIN_DRIVE_RIG"]
KEYS = (
    *("**", "drive/**", f"drive/{RIG}/**", f"drive/{RIG}/*", f"drive/{RIG}/sensor/*"),
    *(f"drive/{RIG}/episode", f"drive/{RIG}/tick", f"drive/{RIG}/control/simulator"),
    *(f"drive/{RIG}/sensor/boxes", "view/**", "worker/**", "conductor/**"),
)


def main(path):
    arrived = queue.SimpleQueue()
    config = zenoh.Config()
    for key, value in {
        "mode": "peer",
        "connect/endpoints": [os.environ["TWIN_DRIVE_CONNECT"]],
        "namespace": os.environ["TWIN_DRIVE_NAMESPACE"],
        "scouting/multicast/enabled": False,
        "transport/shared_memory/enabled": False,
    }.items():
        config.insert_json5(key, json.dumps(value))
    session = zenoh.open(config)
    keep = zenoh.handlers.Callback(arrived.put, indirect=False)
    subscribers = [session.declare_subscriber(key, keep) for key in KEYS]

    def say(topic, message):
        key, data = f"drive/{RIG}/{topic}", msgpack.packb(message)
        session.put(key, data, congestion_control=zenoh.CongestionControl.BLOCK)

    answered = -1
    with Path(path).open("ab", buffering=0) as file:

        def write(**entry):
            data = msgpack.packb(entry)
            file.write(struct.pack("<I", len(data)) + data)

        write(key="start", payload=json.dumps([sys.argv, dict(os.environ)]).encode())
        for key in ("drive/*/control", f"drive/{RIG}/control", "view/*/*/control"):
            for reply in session.get(key, payload=b"", timeout=1.0):
                write(key="reply", payload=reply.ok.payload.to_bytes() if reply.ok else b"")
        while subscribers:
            sample = arrived.get()
            data = sample.payload.to_bytes()
            attachment = sample.attachment.to_bytes() if sample.attachment else b""
            write(key=str(sample.key_expr), payload=data, attachment=attachment)
            if str(sample.key_expr).endswith("/control/simulator"):
                say(
                    "control/stack", {"v": 1, "role": "stack", "rig": RIG, "slots": 1, "seen": True}
                )
            elif str(sample.key_expr).endswith("/tick"):
                tick = msgpack.unpackb(data)
                command = {"slot": 0, "token": tick["token"][0], "tick": tick["tick"][0]}
                command |= {"throttle": 0.2, "brake": 0.0, "steering_rad": 0.0}
                if tick["seq"] > answered:
                    say("command", {"v": 1, "seq": tick["seq"], "commands": [command]})
                    answered = tick["seq"]


if __name__ == "__main__":
    main(sys.argv[1])
