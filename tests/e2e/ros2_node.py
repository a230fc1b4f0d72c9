"""A node of ROS 2 over zenoh_ros2_sdk, which strangers wrote from rmw_zenoh's documentation.

It reads `.msg` files, computes type hashes, opens its session and writes its tokens by that
package alone. What it does with a tick is said by its arguments: ``INTERFACES POLICY [MODES]``.

Policies: ``gap`` brakes for a near box; ``module:Class`` runs a stack of devkit on the plain
table; ``ackermann`` and ``twist`` ask for a speed and stop. Modes, separated by commas, are faults
of one tick; the number at the end of the case's name chooses one.
"""

import os
import queue
import sys
import threading
from pathlib import Path

import numpy as np
from zenoh_ros2_sdk import ROS2Publisher, ROS2Subscriber
from zenoh_ros2_sdk.attachment import Attachment
from zenoh_ros2_sdk.entity import EndpointEntity, EntityKind, NodeEntity
from zenoh_ros2_sdk.keyexpr import endpoint_liveliness_keyexpr, topic_keyexpr
from zenoh_ros2_sdk.message_registry import get_registry

FOLDER, POLICY = Path(sys.argv[1]), sys.argv[2]
MODES = sys.argv[3].split(",") if sys.argv[3:] else []
FAULT_TICK = 3
DOMAIN = int(os.environ["ROS_DOMAIN_ID"])
SENSORS = ("vehicle", "environment", "boxes")
inbox = queue.SimpleQueue()
get_registry().messages_dir = FOLDER


def definition(type_name):
    return (FOLDER / f"{type_name}.msg").read_text()


def subscribe(topic, type_name):
    get_registry().load_message_type(type_name)
    return ROS2Subscriber(
        topic,
        type_name,
        lambda message: inbox.put((topic, message)),
        msg_definition=definition(type_name),
        node_name="driver",
        domain_id=DOMAIN,
    )


def publisher(topic, type_name, name="driver"):
    get_registry().load_message_type(type_name)
    return ROS2Publisher(
        topic, type_name, msg_definition=definition(type_name), node_name=name, domain_id=DOMAIN
    )


def nanoseconds(stamp):
    return stamp.sec * 10**9 + stamp.nanosec


def array(message):
    values = np.frombuffer(message.data.tobytes(), message.dtype).reshape(message.shape)
    return values[None], message.count


class Gap:
    """Drives on, and brakes for good when a box is near."""

    def __init__(self):
        self.braking = False

    def reset(self, episode):
        self.braking = False

    def step(self, tick, stamp_ns, sensors, counts):
        if "boxes" in sensors:
            rows = sensors["boxes"][0, : counts["boxes"]]
            self.braking |= bool((rows[:, 6] < 15.0).any())
        braking = self.braking
        return {"throttle": 0.0 if braking else 0.3, "brake": float(braking), "aeb": braking}


class Devkit:
    """A stack of devkit, which sees nothing but what came over ROS 2."""

    def __init__(self, entry_point):
        from devkit.stack import load_stack

        self.stack, self.token = load_stack(entry_point, 1, {}), 0

    def reset(self, episode):
        from schemas.messages import Episode
        from schemas.wire.codec import decode

        made = decode(episode.msgpack.tobytes(), Episode)
        self.token = made.token
        self.stack.reset(0, made)

    def step(self, tick, stamp_ns, sensors, counts):
        from devkit.stack import Observation

        (command,) = self.stack.step(
            Observation(
                seq=tick,
                active=np.array([True]),
                token=np.array([self.token], np.int64),
                tick=np.array([tick], np.int32),
                sim_time_ns=np.array([stamp_ns], np.int64),
                sensors=sensors,
                counts={name: np.array([count]) for name, count in counts.items() if count >= 0},
            )
        )
        return command


def message_of(store, command):
    """Fields of a DriveCommand."""
    make = lambda name, **fields: store.types[f"drivetwin_msgs/msg/{name}"](**fields)  # noqa: E731
    if isinstance(command, dict):
        lights = make("Lights", low=False, high=False, parking=False, fog=False, indicators=0)
        blank = {"steering_rad": 0.0, "handbrake": 0.0, "reverse": False, "warning": False}
        return {**blank, "trigger": -1, "lights": lights, "detections": [], **command}
    lights = {name: getattr(command.lights, name) for name in command.lights.__struct_fields__}
    return {
        **{
            name: getattr(command, name)
            for name in ("throttle", "brake", "steering_rad", "handbrake", "reverse", "aeb")
        },
        "warning": command.warning,
        "trigger": -1 if command.trigger is None else command.trigger,
        "lights": make("Lights", **lights),
        "detections": [
            make("Detection", **{n: getattr(each, n) for n in each.__struct_fields__})
            for each in command.detections
        ],
    }


def fault(mode, out, fields, stamp):
    """What a node may do wrong at one tick; True: it has answered."""
    import zenoh_ros2_sdk.session as sessions

    session = sessions.ZenohSession.get_instance()
    if mode == "die":
        os._exit(7)
    if mode == "leave":
        out.close()
        threading.Event().wait()
    if mode == "second":
        publisher("/drivetwin/command", "drivetwin_msgs/msg/DriveCommand", "other")
    if mode == "nan":
        fields["throttle"] = float("nan")
    if mode == "future":
        stamp.sec += 5
    if mode == "garbage":
        session.session.put(out.keyexpr, b"\x00\x01\x00\x00hello", attachment=attachment(out))
        return True
    if mode == "huge":
        session.session.put(out.keyexpr, bytes(2 << 20), attachment=attachment(out))
        return True
    if mode == "lengths":
        data = b"\x00\x01\x00\x00" + b"\xff" * 200
        session.session.put(out.keyexpr, data, attachment=attachment(out))
        return True
    if mode == "names":
        old = b"\x0fsequence_number" + bytes(8) + b"\x10source_timestamp" + bytes(8)
        session.session.put(out.keyexpr, b"\x00\x01\x00\x00", attachment=old)
        return True
    if mode == "bare":
        session.session.put(out.keyexpr, b"\x00\x01\x00\x00")
        return True
    return False


def attachment(out):
    return out._create_attachment(out.sequence_number, 0)


def plain(policy):
    """The plain table: a tick is complete when all that it names is there."""
    topics = {f"/drivetwin/sensor/{name}": name for name in SENSORS}
    kept = [subscribe(topic, "drivetwin_msgs/msg/SensorArray") for topic in topics]
    kept.append(subscribe("/drivetwin/front_right/image_raw", "sensor_msgs/msg/Image"))
    kept.append(subscribe("/drivetwin/episode", "drivetwin_msgs/msg/Episode"))
    kept.append(subscribe("/drivetwin/tick", "drivetwin_msgs/msg/Tick"))
    if "type" in MODES:
        kept.append(publisher("/drivetwin/command", "std_msgs/msg/String"))
        threading.Event().wait()
    # The last of all: when it is there, the first tick comes.
    out = publisher("/drivetwin/command", "drivetwin_msgs/msg/DriveCommand")
    store, parts, ticks, episode, mode = out.session_mgr.store, {}, {}, None, ""
    while True:
        topic, message = inbox.get()
        if topic == "/drivetwin/episode":
            episode = message
            mode = MODES[int(message.case_name.rsplit("_", 1)[1])] if MODES else ""
            policy.reset(message)
        elif topic == "/drivetwin/tick":
            ticks[nanoseconds(message.stamp)] = message
        elif topic.endswith("image_raw"):
            picture = message.data.reshape(1, message.height, message.width, 3)
            parts[nanoseconds(message.header.stamp), "camera"] = picture, -1
        else:
            parts[nanoseconds(message.header.stamp), message.name] = array(message)
        for stamp_ns, tick in list(ticks.items()):
            if episode is None or any((stamp_ns, name) not in parts for name in tick.sensors):
                continue
            found = {name: parts[stamp_ns, name] for name in tick.sensors}
            sensors = {name: values for name, (values, _) in found.items()}
            counts = {name: count for name, (_, count) in found.items()}
            fields = message_of(store, policy.step(tick.tick, stamp_ns, sensors, counts))
            fields |= {"stamp": tick.stamp, "tick": tick.tick, "sensor_errors": [], "pose": []}
            del ticks[stamp_ns]
            parts = {key: value for key, value in parts.items() if key[0] != stamp_ns}
            if tick.tick == FAULT_TICK and mode:
                print("now comes", mode, flush=True)
                if fault(mode, out, fields, fields["stamp"]):
                    continue
            out.publish(**fields)
            if tick.tick == FAULT_TICK and mode == "twice":
                out.publish(**fields)


class Stepper:
    """A client of /drivetwin/step. The package's own takes no service with an empty request, so
    this is made of its keys, tokens and attachments."""

    NAME, TYPE = "/drivetwin/step", "std_srvs::srv::dds_::Trigger_"
    HASH = "RIHS01_eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f"

    def __init__(self, manager):
        node = NodeEntity(DOMAIN, manager.session_id, 90, "driver")
        kind, gid = EntityKind.CLIENT, manager.generate_gid()
        client = EndpointEntity(node, 91, kind, self.NAME, self.TYPE, self.HASH, "::,10:,:,:,,")
        self.token = manager.liveliness.declare_token(endpoint_liveliness_keyexpr(client))
        self.key = topic_keyexpr(DOMAIN, self.NAME, self.TYPE, self.HASH)
        self.session, self.gid, self.sequence = manager.session, gid, 0

    def call(self):
        self.sequence += 1
        attachment = Attachment(self.sequence, 0, self.gid).to_bytes()
        (reply,) = self.session.get(self.key, payload=b"\0\1\0\0\0", attachment=attachment)
        answer = Attachment.from_bytes(reply.ok.attachment.to_bytes())
        assert (answer.sequence_id, answer.gid) == (self.sequence, self.gid)
        assert reply.ok.payload.to_bytes()[4] == 1, "success"


def moving(kind):
    """A speed for a while, then 0: Ackermann by stamp, Twist by the service of steps."""
    stamped = kind == "ackermann"
    name = "ackermann_msgs/msg/AckermannDriveStamped" if stamped else "geometry_msgs/msg/Twist"
    kept = [subscribe("/clock", "rosgraph_msgs/msg/Clock")]
    out = publisher("/drive", name)
    types = out.session_mgr.store.types
    stepper = None if stamped else Stepper(out.session_mgr)
    while kept:
        _, message = inbox.get()
        now_s = nanoseconds(message.clock) / 1e9
        speed = 5.0 if now_s < 1.0 else 0.0
        if stamped:
            drive = types["ackermann_msgs/msg/AckermannDrive"](
                steering_angle=0.0,
                steering_angle_velocity=0.0,
                speed=speed,
                acceleration=0.0,
                jerk=0.0,
            )
            header = types["std_msgs/msg/Header"](stamp=message.clock, frame_id="base_link")
            out.publish(header=header, drive=drive)
        else:
            vector = types["geometry_msgs/msg/Vector3"]
            zero = vector(x=0.0, y=0.0, z=0.0)
            out.publish(linear=vector(x=speed, y=0.0, z=0.0), angular=zero)
            stepper.call()


if POLICY in ("ackermann", "twist"):
    moving(POLICY)
else:
    plain(Devkit(POLICY) if ":" in POLICY else Gap())
