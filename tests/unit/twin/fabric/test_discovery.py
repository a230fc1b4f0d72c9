"""``conductor.json``: found, awaited, stale."""

import socket
import threading

import msgspec
import pytest

from twin.base.errors import UnreachableError, UsageError
from twin.fabric.discovery import (
    FILE_NAME,
    OUTCOMES_NAME,
    ConductorFile,
    RunEndedError,
    Target,
    await_conductor,
    await_endpoint,
    choose_target,
    find_conductor,
    refuse_ended,
)
from twin.fabric.keys.authority import load_authority, make_keys
from twin.fabric.keys.roles import Role


def announce(folder, port):
    content = ConductorFile(f"tcp/127.0.0.1:{port}", 1, "h", 1, "twin", "0")
    whole = folder / "whole"
    whole.write_bytes(msgspec.json.encode(content))
    whole.replace(folder / FILE_NAME)  # as a conductor does: it is never seen half
    return content


def test_missing_and_damaged(tmp_path):
    with pytest.raises(UsageError, match="no conductor serves this folder"):
        find_conductor(tmp_path)
    (tmp_path / FILE_NAME).write_text("{")
    with pytest.raises(UsageError, match="damaged"):
        find_conductor(tmp_path)


def test_a_stale_file_is_no_conductor(tmp_path):
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        announce(tmp_path, silent.getsockname()[1])
        with pytest.raises(UnreachableError, match="no conductor answers"):
            await_conductor(tmp_path, 0, Role.worker)


def test_a_conductor_that_comes_later_is_awaited(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        timer = threading.Timer(0.3, announce, (tmp_path, port))
        timer.start()
        assert await_conductor(tmp_path, 60, Role.worker).endpoint == f"tcp/127.0.0.1:{port}"
        timer.join()


def test_the_namespace_of_an_invitation_counts_and_is_not_contradicted(tmp_path):
    keys = make_keys(tmp_path / "keys")
    invited, plain = tmp_path / "mine.key", keys / "viewer.key"
    invited.touch(0o600)
    invited.write_bytes(load_authority(keys).issue(Role.viewer, 1, "tls/a:1", "mine"))

    def chosen(connect, namespace, key):
        found = choose_target(connect, None, namespace, key, Role.viewer)
        return found.endpoint, found.namespace

    assert chosen("", "twin", invited) == ("tls/a:1", "mine")
    assert chosen("tls/b:1", "twin", invited) == ("tls/b:1", "mine"), "another way to the same"
    assert chosen("tls/b:1", "mine", invited) == ("tls/b:1", "mine")
    assert chosen("tls/b:1", "other", plain) == ("tls/b:1", "other"), "that says nothing"
    for connect in ("", "tls/b:1"):
        with pytest.raises(UsageError, match="an invitation to namespace mine; leave --name"):
            chosen(connect, "other", invited)
    invited.write_bytes(load_authority(keys).issue(Role.viewer, 1, "tls/a:1"))
    assert chosen("", "other", invited) == ("tls/a:1", "other"), "whoever made it did not know"


def campaign(folder, *, complete):
    """A campaign folder that no conductor serves now."""
    folder.mkdir()
    (folder / OUTCOMES_NAME).write_text(f'{{"complete": {str(complete).lower()}, "cases": {{}}}}')
    return folder


def test_a_run_that_has_ended_points_to_its_report_and_recordings(tmp_path):
    folder = campaign(tmp_path / "done", complete=True)
    for look in (find_conductor, refuse_ended, lambda f: choose_target("", f, "", None, "viewer")):
        with pytest.raises(RunEndedError) as error:
            look(folder)
        assert f"`conductor report {folder}`" in str(error.value)
        assert f"`viewer replay {folder}`" in str(error.value)
        assert "\n" not in str(error.value)


def test_nobody_waits_for_a_folder_that_is_not_there(tmp_path):
    with pytest.raises(UsageError, match="none: no such folder"):
        refuse_ended(tmp_path / "none")


def test_a_conductor_may_come_to_a_run_that_has_not_ended(tmp_path):
    assert refuse_ended(tmp_path) is None
    assert refuse_ended(campaign(tmp_path / "cut", complete=False)) is None
    again = campaign(tmp_path / "again", complete=True)
    announce(again, 1)  # of a conductor that runs some of its cases once more
    assert refuse_ended(again) is None


def test_an_endpoint_may_be_on_its_way():
    with socket.socket() as later:
        later.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{later.getsockname()[1]}"
        with pytest.raises(UnreachableError, match="no conductor answers"):
            await_endpoint(Target(endpoint, "twin", None), 0.1)
        begins = threading.Timer(0.3, later.listen)
        begins.start()
        await_endpoint(Target(endpoint, "twin", None), 60)
        begins.join()
