"""A stack in plain Python: drives on, and brakes for good when a box is near (drive-plane.md)."""

import json
import os
import queue

import msgpack
import numpy as np
import zenoh

RIG, SLOTS = os.environ["TWIN_DRIVE_RIG"], int(os.environ["TWIN_DRIVE_SLOTS"])
braking, OFF = [False] * SLOTS, {"enabled": False}
OPTIONS = {"connect": {"endpoints": [os.environ["TWIN_DRIVE_CONNECT"]]}}
OPTIONS |= {"scouting": {"multicast": OFF}, "transport": {"shared_memory": OFF}}
OPTIONS |= {"namespace": os.environ["TWIN_DRIVE_NAMESPACE"]}
GAP_M = json.loads(os.environ["TWIN_STACK_PARAMETERS"]).get("gap_m", 15.0)
NOTHING, BLOCK = np.zeros((SLOTS, 0, 7)), zenoh.CongestionControl.BLOCK


def drive(tick, sensors):
    """One command per active slot; column 6 of a box is its distance [m], 0 in unused rows."""
    for slot in (s for s in range(SLOTS) if tick["active"][s]):
        gap_m = sensors.get("boxes", NOTHING)[slot, :, 6]
        braking[slot] |= bool(((gap_m > 0) & (gap_m < GAP_M)).any())
        command = {"slot": slot, "token": tick["token"][slot], "tick": tick["tick"][slot]}
        command |= {"throttle": 0.0 if braking[slot] else 0.3, "brake": float(braking[slot])}
        yield command | {"steering_rad": 0.0, "aeb": braking[slot]}


def say(topic, message):
    session.put(f"drive/{RIG}/{topic}", msgpack.packb(message), congestion_control=BLOCK)


inbox = queue.SimpleQueue()
session = zenoh.open(zenoh.Config.from_json5(json.dumps(OPTIONS)))
in_order = zenoh.handlers.Callback(inbox.put, indirect=False)  # else each topic has its own queue
for topic in ("control/simulator", "episode", "sensor/*", "tick"):
    session.declare_subscriber(f"drive/{RIG}/{topic}", in_order)
arrays, fresh, answer = {}, set(), {"seq": -1}
while True:
    sample = inbox.get()
    topic, data = str(sample.key_expr).split("/", 2)[2], sample.payload.to_bytes()
    head = msgpack.unpackb(sample.attachment.to_bytes() if "sensor/" in topic else data)
    if topic == "control/simulator":
        say("control/stack", {"v": 1, "role": "stack", "rig": RIG, "slots": SLOTS, "seen": True})
    elif topic == "episode":
        fresh.add((head["seq"], head["slot"]))
    elif topic != "tick":
        arrays[head["seq"], topic[7:]] = np.frombuffer(data, head["dtype"]).reshape(head["shape"])
    elif head["seq"] > answer["seq"]:
        now = {name: array for (seq, name), array in arrays.items() if seq == head["seq"]}
        slots = [slot for seq, slot in fresh if seq == head["seq"]]
        if set(head["sensors"]) <= set(now) and len(slots) == head["episodes"]:  # else: comes again
            for slot in slots:
                braking[slot] = False  # a new case begins here
            answer = {"v": 1, "seq": head["seq"], "commands": list(drive(head, now))}
            say("command", answer)
            arrays, fresh = {}, set()
    elif head["seq"] == answer["seq"]:
        say("command", answer)  # asked again: the same answer, without another step
