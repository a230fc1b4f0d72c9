"""Recordings of workers that share no disk: in the store, past a lost conductor, in a viewer."""

import hashlib

import pytest
from object_store import reached_by, s3_server
from processes import committed, outcomes, wait_for
from test_store_takeover import keys, serve

from conductor.records.fingerprint import fingerprint
from twin.fabric.discovery import find_conductor
from twin.stores.objects import get_object
from twin.stores.opening import open_store

__all__ = ["keys"]

pytest.importorskip("s3fs")
COVER = 'mount -t tmpfs tmpfs "$0" && exec "$@"'
"""Puts an empty folder in the place of one, and goes on as a command."""


def worker(marked, state, keys, endpoint, *options):
    """Start a worker of two slots that does not see the state folder."""
    hidden = ("unshare", "--mount", "sh", "-c", COVER, str(state))
    to = ("--connect", endpoint, "--key", str(keys), "--slots", "2")
    return marked.start("twin", "worker", *to, *options, prefix=hidden)


def endpoint_of(state):
    return find_conductor(state).endpoint


def recorded(folder):
    """What the outcomes name of recordings: case -> its object."""
    if not (folder / "outcomes.json").exists():
        return {}
    rows = outcomes(folder)
    return {name: row["recording"] for name, row in rows.items() if "recording" in row}


@pytest.mark.slow
@pytest.mark.network
def test_recordings_outlive_a_conductor_and_are_looked_at_from_the_store(
    marked, quiet, keys, tmp_path
):
    first, second = tmp_path / "a", tmp_path / "b"
    with s3_server(tmp_path / "s3.log") as port, reached_by(port) as url:
        # One recording after the other: when the next one is named, all before are in the store.
        conductor = serve(marked, first, keys, url, "--view", "record", "--durable", "store")
        submit = ("conductor", "submit", "chaos-16", "--state", str(first), "--key", str(keys))
        assert marked.run(*submit).returncode == 0
        busy = worker(marked, first, keys, endpoint_of(first))
        wait_for(lambda: len(recorded(first / "chaos-16")) >= 3, "three recordings")
        named = recorded(first / "chaos-16")
        conductor.kill()
        busy.kill()
        conductor.communicate()
        busy.communicate()
        assert not list(first.glob("chaos-16/cases/*/*/recording.*")), "nothing was shared"

        successor = serve(marked, second, keys, url, "--view", "record")
        ended = worker(marked, second, keys, endpoint_of(second), "--until-done")
        _, err = ended.communicate()
        assert ended.returncode == 0, err
        assert committed(second / "chaos-16") == 16
        successor.terminate()
        successor.communicate()
        assert fingerprint(second / "chaos-16").sha256 == quiet["fingerprint"]
        verified = marked.run("conductor", "verify", str(second / "chaos-16"))
        assert verified.returncode == 0, verified.stderr

        found = recorded(second / "chaos-16")
        same = [name for name, stored in named.items() if found.get(name) == stored]
        assert len(same) >= len(named) - 1
        store = open_store(url)
        for stored in found.values():
            assert len(get_object(store, stored["sha256"])) == stored["size"]

        read = tmp_path / "read"
        asked = ("conductor", "report", url, "--out", str(read), "--recordings", "all")
        made = marked.run(*asked)
        assert made.returncode == 1, made.stderr
        for name, stored in found.items():
            path = read / outcomes(read)[name]["attempt_dir"] / "recording.rrd"
            assert hashlib.sha256(path.read_bytes()).hexdigest() == stored["sha256"]
        case = min(same)
        frame = tmp_path / "frame.png"
        shot = marked.run("viewer", "frame", str(read), case, "--out", str(frame), "--at", "1")
        assert shot.returncode == 0, shot.stderr
        assert frame.read_bytes().startswith(b"\x89PNG")
