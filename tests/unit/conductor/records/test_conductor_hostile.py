"""Clients, files and folders that mean harm: one line, bounded memory, nothing outside touched."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
from pathlib import Path

import msgpack
import pytest
from conductor_bench import Bench, ended, hello, result, submit

from conductor.core.admit import CAMPAIGNS_MAX, admit
from conductor.core.state import CampaignState, Config, State
from conductor.records.attempts import attempt_folder, leads_away
from conductor.records.outcomes import CaseOutcome
from conductor.records.timeline import FILE_NAME, append_events, mark_start
from conductor.report.reading.recorded import _inside
from conductor.serve.deliveries import Deliveries
from conductor.serve.folders import Folders
from schemas import SCHEMA_VERSION as V
from schemas.campaign import ID_CHARS_MAX
from schemas.files.yaml_file import YamlError, parse_yaml
from schemas.plan import examine, parse_campaign
from schemas.wire.codec import CONTAINERS_MAX, WireError, decode, encode
from schemas.wire.control import Next, Request, Result, Submit
from schemas.wire.delivery import AttemptFiles, files_sha256
from twin.base.errors import InfrastructureError

MEMORY_BYTES = 400 << 20
"""What a child may take above what Python and the libraries need themselves [bytes]."""

PATHS = ("../x", "/etc", "a/../../x", "a\0b", "a\nb", "x" * 5000, "", ".", "..", "a/b")

BOMBS = {
    "aliases": "a: &a [x,x,x,x,x,x,x,x,x,x]\n"
    + "".join(
        f"{chr(98 + i)}: &{chr(98 + i)} [{','.join(['*' + chr(97 + i)] * 10)}]\n" for i in range(12)
    ),
    "alias of itself": "a: &a [*a]",
    "nested lists": "[" * 100_000,
    "nested maps": "{a: " * 50_000,
    "a number without end": f"seed: {'9' * 100_000}",
    "two documents": "--- 1\n--- 2",
    "a program": "!!python/object/apply:os.system [id]",
    "a zero byte": "a: \0",
    "a cursor": "a: 1\n\x1b[2J: b",
}


@pytest.mark.parametrize("text", BOMBS.values(), ids=BOMBS)
def test_yaml_bombs(text: str) -> None:
    with pytest.raises(YamlError) as caught:
        parse_yaml(text, "c.yaml")
    assert str(caught.value).startswith("c.yaml")
    assert str(caught.value).isprintable()


def _limited() -> None:
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY_BYTES, MEMORY_BYTES))


def test_messages_that_swell_are_refused_before_they_do() -> None:
    """Empty maps take 64 times their bytes: without the limit this needs two gigabytes."""
    program = (
        "import msgpack\n"
        "from schemas.wire.control import Request\n"
        "from schemas.wire.codec import WireError, decode\n"
        "bomb = msgpack.packb({'v': 1, 'verb': 'submit', 'campaign': {}})[:-1]\n"
        "bomb += b'\\x81\\xa1a\\xdd' + (15_000_000).to_bytes(4, 'big') + b'\\x80' * 15_000_000\n"
        "try:\n"
        "    decode(bomb, Request)\n"
        "except WireError as error:\n"
        "    print(error)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, preexec_fn=_limited
    )
    assert f"more than {CONTAINERS_MAX} maps and lists" in done.stdout, done.stderr


@pytest.mark.parametrize("name", PATHS)
def test_names_that_are_paths_are_no_campaigns(name: str) -> None:
    campaign, mistakes = parse_campaign({"campaign": name, "matrix": {"weather": ["clear"]}})
    assert campaign is None
    assert mistakes[0].path == "campaign"
    assert mistakes[0].line("c.yaml").isprintable()


@pytest.mark.parametrize("value", PATHS)
def test_case_names_are_folders_below_their_campaign(value: str) -> None:
    """Whatever stands on an axis: a case is refused, or its name is one part of a path."""
    point = {"scenario.scene": value}
    plan, mistakes = examine({"campaign": "c", "cases": [point, {}]})
    cases = [] if plan is None else plan.cases
    for case in cases:
        assert case.id == Path(case.id).name
        assert case.id.isprintable()
        assert len(case.id) <= ID_CHARS_MAX
    assert mistakes or [case.id for case in cases][-1] == "case"


@pytest.mark.parametrize("path", [p for p in PATHS if p])
def test_a_worker_cannot_commit_another_folder(path: str) -> None:
    changed = {"campaign": "c", "case": "a", "token": 1, "outcome": "verdict", "verdict": "pass"}
    bad = msgpack.packb(
        {
            "v": V,
            "verb": "next",
            "worker": "w",
            "seq": 1,
            "k": 0,
            "results": [{**changed, "passed": True, "attempt_dir": path}],
        }
    )
    with pytest.raises(WireError) as caught:
        decode(bad, Request)
    assert "attempt_dir" in str(caught.value)
    good = Next(V, "w", 1, 0, results=[Result(**changed)])
    assert decode(encode(good), Request) == good


@pytest.fixture
def outside(tmp_path: Path) -> Path:
    """A folder of somebody else, with something in it."""
    folder = tmp_path / "outside"
    (folder / "attempt-1").mkdir(parents=True)
    (folder / "attempt-1" / "log.txt").write_text("mine")
    return folder


def test_links_are_not_followed_when_results_are_read(tmp_path: Path, outside: Path) -> None:
    campaign = tmp_path / "campaign"
    (campaign / "cases").mkdir(parents=True)
    (campaign / "cases" / "a").symlink_to(outside)
    assert leads_away(campaign, campaign / "cases" / "a" / "attempt-1")
    for given in ("cases/a/attempt-1", "../outside/attempt-1", str(outside), "a\0"):
        with pytest.raises(InfrastructureError, match=r"outside|symbolic link") as caught:
            attempt_folder(campaign, given)
        assert str(caught.value).isprintable()

    class Row:
        end = CaseOutcome(outcome="verdict", attempt_dir="cases/a/attempt-1")

    class Folder:
        folder = campaign

    assert _inside(Folder, Row, "log.txt") is None  # type: ignore[arg-type]
    (campaign / "cases" / "b" / "attempt-1").mkdir(parents=True)
    assert attempt_folder(campaign, "cases/b/attempt-1").is_dir()


def test_links_are_not_followed_when_results_are_delivered(tmp_path: Path, outside: Path) -> None:
    campaign = tmp_path / "campaign"
    (campaign / "cases").mkdir(parents=True)
    (campaign / "cases" / "a").symlink_to(outside)
    deliveries = Deliveries(lambda _: (str(campaign), ""))
    try:
        files = AttemptFiles(V, "c", "a", 2, b"kpi", b"log", files_sha256(b"kpi", b"log"))
        answer = deliveries.handle(encode(files))
    finally:
        deliveries.close()
    assert not answer.ok
    assert "symbolic link" in answer.error
    assert os.listdir(outside) == ["attempt-1"]


def test_links_are_not_followed_when_leftovers_are_swept(tmp_path: Path, outside: Path) -> None:
    bench = Bench()
    bench.ask(submit())
    bench.ask(hello())
    first = bench.next(k=1).leases[0]
    bench.next(ended=[ended(first, "released")], k=0)
    again = next(x for x in bench.next(k=4).leases if x.case.id == first.case.id)
    bench.next(results=[result(again)], k=0)
    (campaign,) = bench.state.campaigns.values()
    _at(campaign, tmp_path)
    cases = tmp_path / "cases"
    cases.mkdir()
    (cases / again.case.id).symlink_to(outside)
    Folders(tmp_path).sweep(campaign)
    assert (outside / "attempt-1" / "log.txt").read_text() == "mine"


def _at(campaign: CampaignState, folder: Path) -> None:
    campaign.out = str(folder)


@pytest.mark.parametrize("out", ["/tmp/a\0b", "/tmp/a\nb", "/" + "x" * 2000, "relative"])
def test_campaign_folders_that_cannot_be(out: str) -> None:
    plain = {"campaign": "c", "simulator": "noop", "matrix": {"weather": ["clear"]}}
    fact, errors = admit(State(config=Config()), Submit(V, plain, out=out))
    assert fact is None
    assert errors[0].isprintable()
    assert "out folder" in errors[0]


def test_thousands_of_campaigns_come_to_an_end() -> None:
    state = State(config=Config())
    state.campaigns = dict.fromkeys(map(str, range(CAMPAIGNS_MAX)), _Empty())  # type: ignore[arg-type]
    plain = {"campaign": "c", "simulator": "noop", "matrix": {"weather": ["clear"]}}
    fact, (error,) = admit(state, Submit(V, plain))
    assert fact is None
    assert f"at most {CAMPAIGNS_MAX}" in error
    assert "--state" in error


class _Empty:
    """Enough of a campaign to be counted."""

    cases = ()
    out = "/nowhere"


@pytest.mark.parametrize("kind", ["file", "link", "dangling link", "pipe", "folder"])
def test_the_timeline_is_written_into_no_link(tmp_path: Path, kind: str) -> None:
    precious, out = tmp_path / "precious", tmp_path / "out"
    precious.write_text("mine")
    out.mkdir()
    path = out / FILE_NAME
    if "link" in kind:
        path.symlink_to(precious if kind == "link" else tmp_path / "nowhere")
    elif kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    bench = Bench()
    bench.ask(submit(cases=1, out=str(out)))
    bench.ask(hello())
    bench.lease()
    append_events(bench.journal, bench.state.campaigns, 1.0)
    mark_start(out, 2.0)
    assert precious.read_text() == "mine"
    assert not (tmp_path / "nowhere").exists()
    if kind == "file":
        assert [json.loads(line)["event"] for line in path.read_text().splitlines()] == [
            "leased",
            "started",
        ]
