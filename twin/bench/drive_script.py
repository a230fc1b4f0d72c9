"""A script in the manner of the AutoDRIVE devkit that looks at nothing; run by the bench."""

import sys

import eventlet
import eventlet.wsgi
import socketio

sio = socketio.Server(max_http_buffer_size=10**8)  # as in 2020; today 1 MB is the default
BRAKE = {"V1 Throttle": "0", "V1 Steering": "0", "V1 Brake": "1", "V1 Handbrake": "0"}


@sio.on("Bridge")
def bridge(sid, data):  # noqa: ARG001 - what Socket.IO hands over
    """Answer every message with full brakes."""
    sio.emit("Bridge", data=BRAKE)


if __name__ == "__main__":
    app = socketio.WSGIApp(sio)
    port = eventlet.listen(("127.0.0.1", int(sys.argv[1])))
    with open("/dev/null", "w") as nowhere:  # noqa: PTH123 - it logs every request
        eventlet.wsgi.server(port, app, log=nowhere)
