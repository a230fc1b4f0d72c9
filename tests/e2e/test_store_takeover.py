"""A campaign whose store breaks in every way, and whose conductor is lost with its folder."""

import json
from collections import Counter

import pytest
from object_store import FAULTS, broken_wire, objects_asked, reached_by, s3_server
from processes import committed, outcomes, wait_for

from conductor.core.facts import Committed
from conductor.journal.store import Journal
from conductor.records.fingerprint import fingerprint
from twin.fabric.discovery import find_conductor

pytest.importorskip("s3fs")


def serve(marked, state, keys, url, *options):
    """Start a conductor with a store and wait until it listens."""
    command = ("conductor", "serve", "--state", str(state), "--key", str(keys), "--store", url)
    child = marked.start(*command, *options)

    def listens():
        assert child.poll() is None, child.communicate()
        return (state / "conductor.json").exists() and find_conductor(state).pid == child.pid

    wait_for(listens, "the conductor")
    return child


def worker(marked, state, keys, *options):
    """Start a worker of two slots."""
    state_and_key = ("--state", str(state), "--key", str(keys))
    return marked.start("twin", "worker", *state_and_key, "--slots", "2", *options)


@pytest.fixture
def keys(marked, tmp_path):
    """A folder of keys, which both conductors have."""
    made = marked.run("conductor", "keygen", str(tmp_path / "keys"))
    assert made.returncode == 0, made.stderr
    return tmp_path / "keys"


@pytest.mark.slow
def test_a_successor_with_an_empty_folder_ends_the_campaign(marked, quiet, keys, tmp_path):
    first, second = tmp_path / "a", tmp_path / "b"
    with (
        s3_server(tmp_path / "s3.log") as port,
        broken_wire(port) as wire,
        reached_by(wire.port) as url,
    ):
        wire.faults = dict.fromkeys(FAULTS, 0.05)
        conductor = serve(marked, first, keys, url)
        submit = ("conductor", "submit", "chaos-16", "--state", str(first), "--key", str(keys))
        assert marked.run(*submit).returncode == 0
        busy = worker(marked, first, keys)
        wait_for(lambda: committed(first / "chaos-16") >= 3, "three cases")
        wire.down = True
        before = len(wire.asked)
        wait_for(lambda: len(wire.asked) > before + 20, "tries of a store that is away")
        assert conductor.poll() is None
        assert busy.poll() is None
        wire.down = False
        count = committed(first / "chaos-16")
        wait_for(lambda: committed(first / "chaos-16") > count, "a case after the store is back")
        conductor.kill()
        busy.kill()
        conductor.communicate()
        busy.communicate()

        wire.faults["stale listing"] = 1.0
        successor = serve(marked, second, keys, url)
        ended = worker(marked, second, keys, "--until-done")
        assert ended.wait() == 0
        rows = outcomes(second / "chaos-16")
        assert {row["outcome"] for row in rows.values()} == {"verdict"}
        successor.terminate()
        out, err = successor.communicate()
        assert successor.returncode == 1, "a verdict is not a pass"
        assert set(wire.done) == set(FAULTS)

        # Nobody is told the credentials, and they are written nowhere.
        assert "not-to-be-told" not in out + err
        texts = [path for path in tmp_path.rglob("*") if path.is_file()]
        assert not [path for path in texts if b"not-to-be-told" in path.read_bytes()]

        assert fingerprint(second / "chaos-16").sha256 == quiet["fingerprint"]
        journal = Journal(second)
        facts = Counter(f.result.case for f in journal.fold() if isinstance(f, Committed))
        journal.close()
        assert (len(facts), set(facts.values())) == (16, {1})
        verified = marked.run("conductor", "verify", str(second / "chaos-16"))
        assert verified.returncode == 0, verified.stderr

        # A report anywhere has the same values, and reads no log and no journal.
        wire.faults, wire.asked = {}, []
        asked = ("conductor", "report", url, "--out", str(tmp_path / "read"), "--output", "json")
        made = marked.run(*asked)
        assert made.returncode == 1, made.stderr
        shown = json.loads(made.stdout)
        assert (shown["cases_total"], shown["fingerprint"]) == (16, quiet["fingerprint"])
        kinds = Counter(name.split("/")[0] for name in objects_asked(wire))
        assert kinds["objects"] == 16
        assert set(kinds) == {"attempts", "objects", "runs"}


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (("--store", "ftp://host/x"), "no store of this scheme"),
        (("--store", "s3://key:secret@bucket"), "credentials in a URL"),
        (("--durable", "store"), "--durable store belongs to --store"),
    ],
)
def test_a_store_that_cannot_be_used_is_one_line(marked, tmp_path, options, line):
    done = marked.run("conductor", "serve", "--state", str(tmp_path / "s"), *options)
    assert done.returncode == 2
    (told,) = done.stderr.strip().splitlines()
    assert line in told
    assert not (tmp_path / "s").exists()


def test_a_bucket_that_is_not_there_is_one_line(marked, tmp_path):
    with s3_server(tmp_path / "s3.log") as port, reached_by(port):
        for command in (
            ("conductor", "serve", "--state", str(tmp_path / "s"), "--store", "s3://elsewhere/x"),
            ("conductor", "report", "s3://elsewhere/x"),
        ):
            done = marked.run(*command)
            assert done.returncode == 2, done.stderr
            (told,) = done.stderr.strip().splitlines()
            assert "s3://elsewhere/x: there is no such bucket" in told
