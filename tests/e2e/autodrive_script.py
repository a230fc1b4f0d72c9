"""A script in the manner of the AutoDRIVE devkit: nothing in it knows of this project.

It is the Socket.IO server, parses every field of the simulator's message, and answers each. Runs on
Python 3.8 with python-socketio 4.2, and on current versions.
"""

import base64
import os
import sys
from io import BytesIO

import eventlet
import socketio
from flask import Flask
from PIL import Image

MODE = sys.argv[1] if len(sys.argv) > 1 else "drive"
PORT = int(sys.argv[2]) if len(sys.argv) > 2 else 4567
sio = socketio.Server()
app = Flask(__name__)
seen = {"count": 0, "start": None}


def numbers(text):
    return [float(word) for word in text.split(" ")]


@sio.on("connect")
def connect(sid, environ):
    print("Connected!")


@sio.on("Bridge")
def bridge(sid, data):
    if not data:
        return
    collisions = int(data["V1 Collisions"])
    feedback = [float(data["V1 " + n]) for n in ("Throttle", "Steering", "Brake", "Handbrake")]
    assert all(-1.0 <= value <= 1.0 for value in feedback)
    ticks = [int(word) for word in data["V1 Encoder Ticks"].split(" ")]
    angles = numbers(data["V1 Encoder Angles"])
    position = numbers(data["V1 Position"])
    quaternion = numbers(data["V1 Orientation Quaternion"])
    euler = numbers(data["V1 Orientation Euler Angles"])
    rates, accelerations = (
        numbers(data["V1 Angular Velocity"]),
        numbers(data["V1 Linear Acceleration"]),
    )
    left = Image.open(BytesIO(base64.b64decode(data["V1 Left Camera Image"])))
    right = Image.open(BytesIO(base64.b64decode(data["V1 Right Camera Image"])))
    base64.b64decode(data["V1 LIDAR Pointcloud"])
    assert collisions == 0
    assert len(ticks) == len(angles) == 2
    assert left.format == right.format == "JPEG"
    assert left.size == right.size
    assert abs(sum(q * q for q in quaternion) - 1) < 1e-6
    assert len(euler) == len(rates) == len(accelerations) == 3
    if seen["start"] is None:
        seen["start"] = position + quaternion
        print("first picture", left.size, "at", position, "accelerations", accelerations)
    gone_m = sum((position[i] - seen["start"][i]) ** 2 for i in range(3)) ** 0.5
    seen["count"] += 1
    stop = gone_m > 6.0
    answer = {
        "V1 CoSim": "0",
        "V1 PosX": "0",
        "V1 PosY": "0",
        "V1 PosZ": "0",
        "V1 RotX": "0",
        "V1 RotY": "0",
        "V1 RotZ": "0",
        "V1 RotW": "1",
        "V1 Throttle": "0.0" if stop else "0.3",
        "V1 Steering": "0.0",
        "V1 Brake": "1.0" if stop else "0.0",
        "V1 Handbrake": "0.0",
        "V1 Headlights": "3",
        "V1 Indicators": "3" if stop else "0",
        "Auto Time": "False",
        "Time Scale": "60",
        "Time": "560",
        "Weather": "3",
        "Clouds": "0",
        "Fog": "0",
        "Rain": "0",
        "Snow": "0",
    }
    if MODE == "cosim":  # its own model: 5 m/s along a line, for six metres
        x, y, z, qx, qy, qz, qw = seen["start"]
        pose = (x + 0.25 * min(seen["count"], 24), y, z, qx, qy, qz, qw)
        names = ("PosX", "PosY", "PosZ", "RotX", "RotY", "RotZ", "RotW")
        answer.update(("V1 " + name, str(pose[i])) for i, name in enumerate(names))
        answer["V1 CoSim"] = "1"
    if seen["count"] == 4:
        print("now comes", MODE, flush=True)
        if MODE == "slow":
            eventlet.sleep(1000)
        if MODE == "exit":
            os._exit(5)
        if MODE == "garbage":
            answer = "hello"
        if MODE == "missing":
            del answer["V1 Throttle"]
        if MODE == "word":
            answer["V1 Steering"] = "left"
        if MODE == "nan":
            answer["V1 Throttle"] = "nan"
        if MODE == "disconnect":
            sio.disconnect(sid)
            return
    sio.emit("Bridge", data=answer)


if __name__ == "__main__":
    if MODE == "absent":
        eventlet.sleep(1000)
    if MODE == "http":
        eventlet.wsgi.server(eventlet.listen(("", PORT)), app)
    app = (
        socketio.Middleware(sio, app)
        if hasattr(socketio, "Middleware")
        else socketio.WSGIApp(sio, app)
    )
    eventlet.wsgi.server(eventlet.listen(("", PORT)), app)
