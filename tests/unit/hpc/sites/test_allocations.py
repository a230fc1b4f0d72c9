"""The book of a run, whatever the batch system answers; and the scaler above it."""

import json
import shutil

import pytest

import hpc.sites.allocations
from hpc.commands import Place, UnknownOutcomeError, at, call
from hpc.kubernetes.objects import run_name
from hpc.scheduler import JobStatus
from hpc.sites.allocations import Allocations, alone, book_of
from hpc.sites.command import all_of, parse_target
from hpc.sites.file import NamedSite, SiteEntry, SitesFile
from hpc.sites.requests import CommonOptions, remote_folder, request_of
from hpc.sites.scaler import GONE_S, LOG_NAME, Scaler, is_complete
from hpc.sites.scaling import FIRST_REST_S, SiteRoom, WorkerTarget
from twin.base.errors import InfrastructureError, UnreachableError, UsageError

NOW_S = 1_000_000.0


class Ledger:
    """A batch system that answers as it is told to."""

    name = "slurm"

    def __init__(self):
        self.answer = "1"
        self.jobs = {}
        self.cancelled = []

    def render(self, request):
        return f"#!/bin/sh\n# {request.allocation}\n"

    def check(self, text, request, /):
        pass

    def submit(self, path, folder):
        if isinstance(self.answer, Exception):
            raise self.answer
        job = str(len(self.jobs) + 1)
        self.jobs[job] = JobStatus("pending", "PENDING")
        return job

    def status(self, job):
        found = self.jobs[job]
        if isinstance(found, Exception):
            raise found
        return found

    def cancel(self, job):
        self.cancelled.append(job)


@pytest.fixture
def ledger(monkeypatch):
    made = Ledger()
    monkeypatch.setattr(hpc.sites.allocations, "backend", lambda name: made)
    return made


def site(**more):
    entry = SiteEntry(scheduler="slurm", workers=2, time="01:00", bin="/opt/bin", **more)
    return NamedSite("north", "slurm", entry)


def allocations(folder, campaign="aeb-demo", entry=None):
    def request(of, allocation, run):
        return request_of(
            *(of, allocation),
            campaign=campaign,
            out=folder,
            connect="tls/login:7447",
            common=CommonOptions(),
            run=run,
        )

    return Allocations(folder, campaign, {"north": entry or site()}, request, lambda _: b"KEY\n")


def test_asked_for(ledger, tmp_path):
    book = allocations(tmp_path)
    made = book.ask(site(), "because", NOW_S)
    assert (made.id, made.job, made.state, made.workers) == ("north-1", "1", "queued", 2)
    folder = tmp_path / "sites" / "north-1"
    assert (folder / "job.sh").read_text().endswith("# north-1\n")
    assert (folder / "worker.key").stat().st_mode & 0o777 == 0o600
    again = book_of(tmp_path)
    assert [each.id for each in again.allocations] == ["north-1"]
    assert book.spent_h == 2.0


def test_written_down_before_it_is_submitted(ledger, tmp_path, monkeypatch):
    seen = []
    monkeypatch.setattr(ledger, "check", lambda *_: seen.append(book_of(tmp_path)))
    allocations(tmp_path).ask(site(), "because", NOW_S)
    (book,) = seen
    assert [(each.id, each.state) for each in book.allocations] == [("north-1", "wanted")]


def test_a_refusal_ends_it_and_the_site_rests(ledger, tmp_path):
    book = allocations(tmp_path)
    ledger.answer = UsageError("Slurm did not take the job: no such account")
    with pytest.raises(UsageError, match="no such account"):
        book.ask(site(), "because", NOW_S)
    assert book.open == []
    record = book_of(tmp_path).sites["north"]
    assert (record.failures, record.rests_until_s) == (1, NOW_S + FIRST_REST_S)
    assert book.spent_h == 0.0
    ledger.answer = "1"
    assert book.ask(site(), "because", NOW_S).id == "north-2", "numbers are never used again"


@pytest.mark.parametrize("error", [InfrastructureError("no answer"), UnknownOutcomeError("lost")])
def test_what_is_not_known_stays_wanted(ledger, tmp_path, error):
    book = allocations(tmp_path)
    ledger.answer = error
    with pytest.raises(InfrastructureError):
        book.ask(site(), "because", NOW_S)
    (wanted,) = allocations(tmp_path).open
    assert (wanted.id, wanted.job, wanted.state) == ("north-1", "", "wanted")


def test_what_nobody_knows_is_forgotten_when_its_time_is_over(ledger, tmp_path):
    book = allocations(tmp_path)
    ledger.answer = UnknownOutcomeError("lost")
    with pytest.raises(UnknownOutcomeError):
        book.ask(site(), "because", NOW_S)
    for after_s, count in ((0.0, 1), (7200.0, 1), (7200.1, 0)):
        with pytest.raises(UnknownOutcomeError):
            book.submit(book.open[0], NOW_S + after_s)
        assert len(book.open) == count


@pytest.mark.parametrize(
    ("joined", "status", "failures"),
    [
        (True, JobStatus("ended", "COMPLETED", exit_code=0), 0),
        (True, JobStatus("ended", "FAILED", exit_code=75), 0),
        (True, JobStatus("ended", "CANCELLED", exit_code=143), 0),
        (True, JobStatus("gone"), 0),
        (True, JobStatus("ended", "FAILED", exit_code=137), 2),
        (False, JobStatus("ended", "COMPLETED", exit_code=0), 2),
        (False, JobStatus("gone"), 2),
    ],
)
def test_ends(ledger, tmp_path, joined, status, failures):
    book = allocations(tmp_path)
    book.ask(site(), "because", NOW_S)
    book.book.sites["north"].failures = 1
    ledger.jobs["1"] = status
    lines = book.refresh({"north-1"} if joined else set(), NOW_S + 60)
    assert lines[0].startswith("north-1: ended, ")
    assert book.open == []
    assert book_of(tmp_path).sites["north"].failures == failures


def test_a_site_that_does_not_answer(ledger, tmp_path):
    book = allocations(tmp_path)
    book.ask(site(), "because", NOW_S)
    ledger.jobs["1"] = InfrastructureError("login.north: not reached")
    assert book.refresh(set(), NOW_S) == ["north-1: login.north: not reached"]
    assert book.refresh(set(), NOW_S) == [], "once"
    assert [each.state for each in book.open] == ["unreachable"]
    ledger.jobs["1"] = JobStatus("running", "RUNNING")
    assert book.refresh(set(), NOW_S) == ["north-1: running"]


def test_an_answer_that_says_nothing_is_asked_for_again(ledger, tmp_path):
    book = allocations(tmp_path)
    book.ask(site(), "because", NOW_S)
    ledger.jobs["1"] = JobStatus("unknown", "FROZEN")
    line = "north-1: how job 1 stands is not known (slurm says 'FROZEN'); it is asked for again"
    assert book.refresh({"north-1"}, NOW_S) == [line]
    assert book.refresh(set(), NOW_S + 60) == [], "once"
    ledger.jobs["1"] = JobStatus("unknown")
    assert book.refresh(set(), NOW_S + 1e6) == [], "however long it lasts"
    (each,) = book.open
    assert (each.state, each.code, book_of(tmp_path).sites["north"].failures) == (
        "unreachable",
        None,
        0,
    )
    ledger.jobs["1"] = JobStatus("running", "RUNNING")
    assert book.refresh(set(), NOW_S) == ["north-1: running"]


def test_an_odd_answer_to_a_submission_leaves_it_wanted(ledger, tmp_path, monkeypatch):
    answered(tmp_path)
    book = allocations(tmp_path)
    monkeypatch.setattr(ledger, "submit", lambda *_: "Last login: today")
    with pytest.raises(UnknownOutcomeError, match="in place of a job's id"):
        book.ask(site(), "because", NOW_S)
    (wanted,) = allocations(tmp_path).open
    assert (wanted.job, wanted.state) == ("", "wanted"), "the job may be there"
    with pytest.raises(UnknownOutcomeError):
        book.submit(book.open[0], NOW_S + 7200.1)
    assert book.open == []


def test_a_book_of_another_campaign_or_a_damaged_one(ledger, tmp_path):
    allocations(tmp_path).save()
    with pytest.raises(UsageError, match="has allocations for aeb-demo"):
        allocations(tmp_path, campaign="aeb-256")
    (tmp_path / "allocations.json").write_text('{"campaign": "aeb-demo", "allocations": [{}]}')
    with pytest.raises(UsageError, match=r"allocations\.json"):
        allocations(tmp_path)


@pytest.mark.parametrize(
    ("scheduler", "job"), [("slurm", "--help"), ("slurm", "a"), ("lsf", "1"), ("kubernetes", "1")]
)
def test_job_ids_that_are_none_reach_no_command(ledger, tmp_path, scheduler, job):
    book = allocations(tmp_path)
    book.ask(site(), "because", NOW_S)
    made = book.book.allocations[0]
    made.scheduler, made.job = scheduler, job
    book.save()
    with pytest.raises(UsageError, match=r"north-1: .* cannot be"):
        allocations(tmp_path)


def test_looking_writes_nothing(ledger, tmp_path):
    book = allocations(tmp_path)
    book.ask(site(), "because", NOW_S)
    before = (tmp_path / "allocations.json").read_bytes()
    ledger.jobs["1"] = JobStatus("running", "RUNNING")
    assert book.look(set(), NOW_S) == ["north-1: running"]
    assert (tmp_path / "allocations.json").read_bytes() == before
    book.refresh(set(), NOW_S)
    assert (tmp_path / "allocations.json").read_bytes() != before


def test_the_next_run_in_the_same_folder_is_another_one(ledger, tmp_path):
    names, there = set(), site(folder=str(tmp_path / "there"))
    for _ in range(2):
        book = allocations(tmp_path / "run", entry=there)
        with alone(tmp_path / "run"):
            book.ask(there, "because", NOW_S)
        request = book.request(book.sites["north"], "north-1")
        again = allocations(tmp_path / "run", entry=there)
        assert again.request(again.sites["north"], "north-1") == request
        names |= {request.out, run_name(request)}
        shutil.rmtree(tmp_path / "run")
    assert len(names) == 4


def test_looking_does_nothing_at_a_site(ledger, tmp_path, monkeypatch):
    monkeypatch.setattr(hpc.sites.allocations, "RemoteScheduler", Ledger)
    book = allocations(tmp_path)
    book.ask(site(), "because", NOW_S)
    ledger.jobs["1"] = JobStatus("ended", "COMPLETED", exit_code=0)
    allocations(tmp_path).look(set(), NOW_S)
    assert ledger.cancelled == []
    book.refresh(set(), NOW_S)
    assert ledger.cancelled == ["1"]


def answered(folder):
    """The site has kept an answer."""
    (folder / "sites" / "north-1").mkdir(parents=True, exist_ok=True)
    (folder / "sites" / "north-1" / ".submitting").mkdir()
    (folder / "sites" / "north-1" / ".code").write_text("1\n")


def test_a_failure_that_the_site_keeps_ends_it(ledger, tmp_path):
    answered(tmp_path)
    book = allocations(tmp_path)
    ledger.answer = InfrastructureError("sbatch: Unable to contact slurm controller")
    with pytest.raises(InfrastructureError, match="Unable to contact"):
        book.ask(site(), "because", NOW_S)
    assert book_of(tmp_path).allocations[0].state == "ended"
    assert book_of(tmp_path).sites["north"].failures == 1
    ledger.answer = "1"
    assert book.ask(site(), "because", NOW_S).id == "north-2"


def test_after_a_timeout_nobody_knows_until_its_time_is_over(ledger, tmp_path):
    answered(tmp_path)
    book = allocations(tmp_path)
    ledger.answer = InfrastructureError("sbatch: Socket timed out on send/recv operation")
    with pytest.raises(UnknownOutcomeError, match="not known"):
        book.ask(site(), "because", NOW_S)
    (wanted,) = book.open
    with pytest.raises(InfrastructureError):
        book.submit(wanted, NOW_S + 7200.1)
    assert book.open == []


def test_what_has_no_job_yet_gets_none_after_its_end(ledger, tmp_path):
    book = allocations(tmp_path)
    ledger.answer = InfrastructureError("login.north: not reached")
    with pytest.raises(InfrastructureError):
        book.ask(site(), "because", NOW_S)
    (wanted,) = book.open
    book.end(wanted, "cancelled", NOW_S)
    assert (wanted.state, wanted.why) == ("ended", "cancelled, before it was submitted")
    folder = tmp_path / "sites" / "north-1"
    with at(Place(once=str(folder), submits="sh")):
        done = call("sh", "-c", "touch submitted")
    assert (done.code, done.err) == (1, "it was ended before it was submitted\n")
    assert not (folder / "submitted").exists()


def test_what_may_have_a_job_is_not_called_ended(ledger, tmp_path):
    book = allocations(tmp_path)
    ledger.answer = InfrastructureError("no answer")
    with pytest.raises(InfrastructureError):
        book.ask(site(), "because", NOW_S)
    answered(tmp_path)
    (wanted,) = book.open
    with pytest.raises(InfrastructureError, match="not known here"):
        book.end(wanted, "cancelled", NOW_S)
    assert book.open == [wanted]


def test_sites_of_the_book_that_the_command_line_does_not_name(ledger, tmp_path):
    book = allocations(tmp_path)
    book.ask(site(), "because", NOW_S)
    south = NamedSite("south", "slurm", SiteEntry(scheduler="slurm", workers=1, time="01:00"))
    file = SitesFile(sites={"north": site().entry, "south": south.entry})
    assert [each.name for each in all_of(tmp_path, [south], file)] == ["south", "north"]
    bare = Allocations(tmp_path, "aeb-demo", {"south": south}, book.request_of, lambda _: b"")
    with pytest.raises(UsageError, match="the sites file has no site north"):
        bare.end(bare.open[0], "cancelled", NOW_S)
    made, said = scaler(tmp_path, [state(left=0)])
    made.allocations = bare
    assert made.turn(NOW_S) == 0
    assert [line for line in said if line.startswith("note: north-1: the sites file has no site")]


def test_only_one_asks(tmp_path):
    with (
        alone(tmp_path / "run"),
        pytest.raises(UsageError, match="another `hpc submit`"),
        alone(tmp_path / "run"),
    ):
        pass
    with alone(tmp_path / "run"):
        pass


# --- the scaler above it ------------------------------------------------------------------------


def worker(allocation, held=0):
    return {"present": True, "tags": [f"allocation:{allocation}"], "held": held, "slots": 1}


def state(left=100, waiting=None, case_s=60.0, workers=(), paused=False):
    row = {
        "left": left,
        "waiting": left if waiting is None else waiting,
        "p95_s": case_s,
        "paused": paused,
    }
    return {"campaigns": {"aeb-demo": row}, "workers": [*workers]}


def scaler(folder, answers, **more):
    said = []

    def status():
        answer = answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer

    room = SiteRoom("north", 2, 4, 4, walltime_h=1.0)
    book = allocations(folder)
    made = Scaler(book, status, WorkerTarget(0, 4), {"north": room}, said.append, **more)
    return made, said


def test_turns(ledger, tmp_path):
    answers = [state(), state(workers=[worker("north-1")]), state(left=0)]
    made, said = scaler(tmp_path, answers)
    assert made.turn(NOW_S) is None
    assert [each.id for each in made.allocations.open] == ["north-1", "north-2"]
    assert made.turn(NOW_S + 1) is None
    assert [each.joined for each in made.allocations.open] == [True, False]
    assert made.turn(NOW_S + 2) == 0
    assert ledger.cancelled == ["2", "1"] or ledger.cancelled == ["1", "2"]
    assert said[0].startswith("ask: north-1: job 1, 100 cases left of 60.0 s each: ")
    assert said[-1] == "end: every case has ended"
    lines = (tmp_path / LOG_NAME).read_text().splitlines()
    assert [json.loads(line)["what"] for line in lines] == [line.split(":")[0] for line in said]


def test_a_dry_run_asks_for_nothing(ledger, tmp_path):
    made, said = scaler(tmp_path, [state()], dry_run=True)
    made.turn(NOW_S)
    assert ledger.jobs == {}
    assert said[0].startswith("would ask: north: 100 cases left")
    assert not (tmp_path / LOG_NAME).exists()


def test_a_paused_campaign_keeps_what_it_has(ledger, tmp_path):
    answers = [state(), state(waiting=0, paused=True), state(waiting=0, paused=True)]
    made, said = scaler(tmp_path, answers)
    for after_s in (0, 1, 2):
        made.turn(NOW_S + after_s)
    assert ledger.cancelled == []
    assert [line for line in said if "paused" in line] == [
        "note: paused; nothing is asked for or ended meanwhile"
    ]


def test_a_submission_that_was_cut_off_is_asked_for_again_after_a_rest(ledger, tmp_path):
    made, said = scaler(tmp_path, [state() for _ in range(3)])
    ledger.answer = InfrastructureError("no answer")
    made.turn(NOW_S)
    assert [each.job for each in made.allocations.open] == ["", ""]
    ledger.answer = "1"
    made.turn(NOW_S + 1)
    assert ledger.jobs == {}, "it rests"
    made.turn(NOW_S + 3600)
    assert [(each.id, each.job) for each in made.allocations.open] == [
        ("north-1", "1"),
        ("north-2", "2"),
    ]
    assert "note: north: no answer" in said


def test_a_conductor_that_does_not_answer(ledger, tmp_path):
    gone = UnreachableError("tls/a:1: nobody answers")
    made, said = scaler(tmp_path, [state(), gone, gone, gone])
    made.turn(NOW_S)
    assert made.turn(NOW_S + 1) is None
    assert made.turn(NOW_S + GONE_S) is None, "it may come back"
    assert ledger.cancelled == []
    assert made.turn(NOW_S + 1 + GONE_S) == 75
    assert sorted(ledger.cancelled) == ["1", "2"]
    assert said[-1] == "end: the conductor has gone"


def test_the_end_is_seen_in_the_outcomes_or_by_the_workers(ledger, tmp_path):
    gone = UnreachableError("nobody")
    made, _ = scaler(tmp_path, [state(), gone])
    made.turn(NOW_S)
    (tmp_path / "outcomes.json").write_text('{"complete": false}')
    assert not is_complete(tmp_path)
    ledger.jobs["1"] = JobStatus("ended", "COMPLETED", exit_code=0)
    made.allocations.book.allocations[0].joined = True
    assert made.turn(NOW_S + 1) == 0, "its workers left because no case was left"
    other, said = scaler(tmp_path, [gone])
    (tmp_path / "outcomes.json").write_text('{"complete": true}')
    assert other.turn(NOW_S) == 0
    assert said[-1] == "end: every case has ended"


@pytest.mark.parametrize("text", ["", "3", "3:2", "0:0", "-1:2", "1:100001", "a:b", "1:2:3"])
def test_targets(text):
    with pytest.raises(UsageError, match="expected MIN:MAX"):
        parse_target(text)
    assert parse_target("0:100000") == (0, 100_000)


def test_folders_of_runs_differ(tmp_path):
    paths = (tmp_path / "a", tmp_path / "b/a")
    folders = {remote_folder("/home/me/dt/", path, run) for path in paths for run in ("1", "2")}
    assert len(folders) == 4
    assert all(folder.startswith("/home/me/dt/a-") for folder in folders)


def test_a_site_says_more_than_the_command_line(tmp_path):
    common = CommonOptions(time="09:00", gpus=8, slots=4)
    words = {"campaign": "aeb-demo", "out": tmp_path, "connect": "tls/a:1", "common": common}
    own = request_of(site(), "north-1", **words)
    assert (own.workers, own.gpus, own.walltime_min, own.slots) == (2, 0, 60, 4)
    bare = NamedSite("south", "slurm", SiteEntry(scheduler="slurm", bin="/b"))
    other = request_of(bare, "south-1", **words)
    assert (other.workers, other.gpus, other.walltime_min) == (0, 8, 540)
    with pytest.raises(UsageError, match=r"site south: .*--time"):
        request_of(bare, "south-1", **{**words, "common": CommonOptions(gpus=1)})
