"""Stands for ``ssh``: forwards for real, runs the command here, and knows hosts that are not there.

Installed as an executable called ``ssh`` by the tests of the tunnel.
"""

import json
import os
import socket
import subprocess
import sys
import threading
from pathlib import Path


def copy(source, sink):
    try:
        while data := source.recv(65536):
            sink.sendall(data)
    except OSError:
        pass
    for end in (source, sink):
        try:
            end.shutdown(socket.SHUT_RDWR)
        except OSError:
            pass


def forward(spec):
    host, port, to, to_port = spec.rsplit(":", 3)
    listener = socket.create_server((host, int(port)))

    def accept():
        while True:
            near, _ = listener.accept()
            far = socket.create_connection((to, int(to_port)))
            for pair in ((near, far), (far, near)):
                threading.Thread(target=copy, args=pair, daemon=True).start()

    threading.Thread(target=accept, daemon=True).start()


def main():
    arguments, options = sys.argv[1:], {}
    while arguments[0] != "--":
        options.setdefault(arguments.pop(0), []).append(arguments.pop(0))
    _, host, command = arguments
    with Path(os.environ["FAKE_SSH_LOG"]).open("a", encoding="utf-8") as log:
        log.write(json.dumps({"host": host, "command": command, "pid": os.getpid(), **options}))
        log.write("\n")
    if "nowhere" in host:
        sys.exit(print(f"ssh: Could not resolve hostname {host}", file=sys.stderr) or 255)
    for spec in options.get("-L", []):
        forward(spec)
    print("Welcome to the cluster")
    sys.stdout.flush()
    sys.exit(subprocess.call(["sh", "-c", command]))


main()
