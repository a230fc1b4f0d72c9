"""``conductor.json``: found, awaited, stale."""

import socket
import threading

import msgspec
import pytest

from twin.fabric.discovery import FILE_NAME, ConductorFile, await_conductor, find_conductor
from twin.fabric.errors import UnreachableError, UsageError
from twin.fabric.roles import Role


def announce(folder, port):
    content = ConductorFile(f"tcp/127.0.0.1:{port}", 1, "h", 1, "twin", "0")
    (folder / FILE_NAME).write_bytes(msgspec.json.encode(content))
    return content


def test_missing_and_damaged(tmp_path):
    with pytest.raises(UsageError, match="no conductor serves this folder"):
        find_conductor(tmp_path)
    (tmp_path / FILE_NAME).write_text("{")
    with pytest.raises(UsageError, match="damaged"):
        find_conductor(tmp_path)


def test_a_stale_file_is_no_conductor(tmp_path):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        announce(tmp_path, free.getsockname()[1])
    with pytest.raises(UnreachableError, match="no conductor answers"):
        await_conductor(tmp_path, 0, Role.worker)


def test_a_conductor_that_comes_later_is_awaited(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        timer = threading.Timer(0.3, announce, (tmp_path, port))
        timer.start()
        assert await_conductor(tmp_path, 60, Role.worker).endpoint == f"tcp/127.0.0.1:{port}"
        timer.join()
