"""What clusters answer is bounded, and told escaped on one line, whoever wrote it."""

import sys

import pytest
from waiting import PATIENCE_S

from hpc import commands
from hpc.commands import ProgramEnd, call
from hpc.kubernetes import api
from hpc.pbs.commands import parse_job as parse_qstat
from hpc.pbs.commands import parse_queues
from hpc.scheduler import JOB_ID_CHARS_MAX, PARTITIONS_MAX, JobStatus, Partition, job_id
from hpc.slurm.commands import parse_account, parse_job, parse_sinfo
from twin.base.errors import InfrastructureError

ESCAPE = "\x1b[2J\nlogged in as root"


def python(program, **options):
    return call(sys.executable, "-c", program, **options)


@pytest.mark.parametrize("stream", ["stdout", "stderr"])
def test_a_program_that_never_stops_talking(monkeypatch, stream):
    monkeypatch.setattr(commands, "OUTPUT_BYTES_MAX", 1 << 20)
    text = f"import sys\nwhile True: sys.{stream}.write('x' * 65536)"
    with pytest.raises(InfrastructureError, match="says more than 1048576 bytes"):
        python(text, wait_s=PATIENCE_S)


def test_both_streams_and_a_long_input():
    """Neither waits for the other."""
    text = "import sys; d = sys.stdin.read(); sys.stderr.write(d); sys.stdout.write(d)"
    given = "a" * (1 << 20)
    done = python(text, text=given, wait_s=PATIENCE_S)
    assert (done.code, done.out, done.err) == (0, given, given)


def test_a_program_that_does_not_read():
    done = python("import os; os.close(0); print(7)", text="a" * (1 << 20), wait_s=PATIENCE_S)
    assert (done.code, done.out) == (0, "7\n")


def test_a_program_that_does_not_answer():
    with pytest.raises(InfrastructureError, match="did not answer in 0 s"):
        python("input()\nimport time; time.sleep(1e6)", text="\n", wait_s=0.2)


def test_bytes_that_are_no_text():
    assert python(r"import os; os.write(1, b'\xff\n')").out == "�\n"


def test_last_words_are_told_escaped():
    end = ProgramEnd(1, "", "first\nsqueue: \x1b[31mred\n")
    assert end.last_words == r"squeue: \x1b[31mred"
    assert len(ProgramEnd(1, "", "x" * 10**6).last_words) == commands.WORDS_CHARS_MAX


def test_words_about_jobs_and_partitions_are_told_escaped():
    status = JobStatus("running", native=ESCAPE, reason=ESCAPE, nodes="n" * 1000)
    assert status.native == status.reason == r"\x1b[2J\nlogged in as root"
    assert len(status.nodes) == 300
    assert Partition(ESCAPE).name.isprintable()


@pytest.mark.parametrize("said", ["", "ok", "12\x1b[2J", "1/2", "1" * (JOB_ID_CHARS_MAX + 1)])
def test_no_id_of_a_job(said):
    with pytest.raises(InfrastructureError, match="in place of a job's id") as caught:
        job_id("slurm", said)
    assert "\x1b" not in str(caught.value)
    assert job_id("pbs", "12[].head.example") == "12[].head.example"


NINES = "9" * 5000


@pytest.mark.parametrize(
    ("parse", "text"),
    [
        (parse_job, f"JobState=FAILED Restarts={NINES} ExitCode={NINES}:0"),
        (parse_job, "JobState=FAILED Restarts=-1 ExitCode=x"),
        (parse_job, "="),
        (parse_account, "FAILED|1:0"),
        (parse_account, "|||"),
        (parse_account, f"FAILED|0:{NINES}|n1|many"),
        (parse_account, "\n"),
        (parse_qstat, f"    job_state = F\n    Exit_status = {NINES}\n    run_count = {NINES}\n"),
        (parse_qstat, "    job_state = F\n    Exit_status = --1\n"),
    ],
)
def test_answers_that_are_none(parse, text):
    found = parse(text)
    assert (found.exit_code, found.restarts) in ((None, 0), (0, 0))


def test_partitions_that_are_none():
    assert parse_sinfo("a|b\n|||||\na|b|many|c|d\n") == ()
    many = "".join(f"p{number}|1|1|(null)|up\n" for number in range(PARTITIONS_MAX + 5))
    assert len(parse_sinfo(many)) == PARTITIONS_MAX
    queues = "".join(f"Queue: q{number}\n" for number in range(PARTITIONS_MAX + 5))
    assert len(parse_queues(queues)) == PARTITIONS_MAX
    assert parse_queues("Queue:\n    name = another\n")[0].name == ""


class Answer:
    """A response of urllib3 that never ends."""

    def __init__(self):
        self.response = self

    def read(self, count, decode_content):
        assert decode_content
        return b"x" * count

    def close(self):
        self.response = None


class Client:
    def call_api(self):
        return Answer()


def test_an_answer_of_the_api_that_never_ends(monkeypatch):
    monkeypatch.setattr(api, "ANSWER_BYTES_MAX", 1000)
    with (
        pytest.raises(InfrastructureError, match="pods: the API server's answer is longer than"),
        api.refusals("pods"),
    ):
        api.bounded(Client()).call_api()


@pytest.mark.parametrize(
    "body", [None, "", "null", "[]", '{"message": "\\u001b[2J\\nroot"}', "[" * 100_000]
)
def test_a_refusal_of_the_api_is_one_line(body):
    from kubernetes.client.exceptions import ApiException

    error = ApiException(status=403, reason="For\nbidden")
    error.body = body
    with pytest.raises(api.UsageError) as caught, api.refusals("pods"):
        raise error
    assert str(caught.value).isprintable()
