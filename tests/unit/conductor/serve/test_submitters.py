"""Who may have workers run something: submitting takes a role of its own, apart from steering."""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import msgspec
import pytest
from typer.testing import CliRunner
from waiting import PATIENCE_S

from conductor.bench.own import noop_campaign
from conductor.cli import app
from conductor.commands.client import ConductorClient
from conductor.serve.shell import Conductor
from schemas import SCHEMA_VERSION
from schemas.campaign import Campaign
from schemas.wire import topics
from schemas.wire.codec import decode, encode
from schemas.wire.control import Reply, Submit
from twin.base.errors import UsageError
from twin.fabric.keys.authority import make_keys
from twin.fabric.keys.key_file import LINE_MARK, load_key
from twin.fabric.keys.roles import IN_WORDS, INVITED, Role
from twin.fabric.zenoh_bus import open_bus

SILENCE_S = 0.5
"""How long somebody waits for an answer that must not come."""


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_keys(tmp_path_factory.mktemp("fabric") / "keys")


@pytest.fixture
def conductor(tmp_path: Path, keys: Path) -> Iterator[Conductor]:
    """One that serves over TLS."""
    serves = Conductor(tmp_path / "state", key=load_key(keys, Role.conductor))
    thread = threading.Thread(target=serves.serve, daemon=True)
    thread.start()
    assert serves.started.wait(PATIENCE_S)
    yield serves
    serves.stop()
    thread.join(PATIENCE_S)


def runs_a_command() -> Campaign:
    """A campaign whose stack is a command line."""
    data = {**msgspec.to_builtins(noop_campaign(2)), "autonomy": {"command": ["id"]}}
    return msgspec.convert(data, Campaign)


def client(conductor: Conductor, keys: Path, role: Role) -> ConductorClient:
    return ConductorClient(conductor.endpoint, None, "twin", keys / f"{role}.key", role)


@pytest.mark.parametrize("campaign", [runs_a_command(), noop_campaign(2)])
def test_an_admin_submits_nothing(conductor: Conductor, keys: Path, campaign: Campaign) -> None:
    with (
        client(conductor, keys, Role.admin) as admin,
        pytest.raises(UsageError, match=r"invite --role submitter`$") as refused,
    ):
        admin.submit(campaign, "")
    assert len(str(refused.value).splitlines()) == 1
    assert conductor.snapshot()["campaigns"] == {}


def test_an_admin_that_minds_no_rule_submits_nothing_either(
    conductor: Conductor, keys: Path
) -> None:
    """By the route that is open to it the request is refused, by the right one nothing comes."""
    for role in (Role.admin, Role.viewer, Role.worker):
        lawless = dataclasses.replace(load_key(keys, role), role=Role.conductor)
        submission = encode(
            Submit(v=SCHEMA_VERSION, campaign=msgspec.to_builtins(runs_a_command()))
        )
        with closing(open_bus("client", connect=[conductor.endpoint], key=lawless)) as bus:
            assert bus.request(topics.RPC_SUBMIT.key, submission, SILENCE_S) is None
            patience_s = PATIENCE_S if role is Role.admin else SILENCE_S
            data = bus.request(topics.RPC_ADMIN.key, submission, patience_s)
            if role is Role.admin:
                assert data is not None
                assert "send it to conductor/rpc/submit" in decode(data, Reply).error
            else:
                assert data is None
    assert conductor.snapshot()["campaigns"] == {}


def test_a_submitter_submits_and_steers_nothing(conductor: Conductor, keys: Path) -> None:
    with client(conductor, keys, Role.submitter) as submitter:
        submitter.submit(noop_campaign(2), "")
        assert submitter.status()["campaigns"]["bench"]["left"] == 2
        with pytest.raises(UsageError, match="role submitter may not ask conductor/rpc/admin"):
            submitter.control("cancel", campaign="bench")
        with pytest.raises(UsageError, match="invite --role admin"):
            submitter.stop()
    with client(conductor, keys, Role.admin) as admin:
        assert admin.control("cancel", campaign="bench") == 2


@pytest.mark.parametrize("role", INVITED)
def test_an_invitation_says_in_words_what_it_may(keys: Path, tmp_path: Path, role: Role) -> None:
    path = tmp_path / "invited.key"
    asked = ["invite", "--role", str(role), "--key", str(keys)]
    done = CliRunner().invoke(app, [*asked, "-o", str(path)])
    assert (done.exit_code, done.stdout) == (0, f"{path}\n")
    assert done.stderr == f"conductor: a key of role {role} for 30 days, which {IN_WORDS[role]}\n"
    assert path.read_text().splitlines()[0] == f"role: {role}, {IN_WORDS[role]}"
    assert load_key(path, role).role is role, "what is read by people changes nothing"
    line = CliRunner().invoke(app, asked)
    assert line.stdout.startswith(LINE_MARK.decode())
    assert IN_WORDS[role] in line.stderr


def test_the_words_of_a_submitter_warn_of_what_it_is() -> None:
    assert "commands and code that they name run on every worker" in IN_WORDS[Role.submitter]
    assert "submit nothing" in IN_WORDS[Role.admin]
    assert set(IN_WORDS) == set(Role)
