"""What arrives from a pod is a stranger's archive."""

import contextlib
import io
import tarfile

import pytest
from websocket import WebSocketConnectionClosedException as Lost

import hpc.kubernetes.copying
from hpc.kubernetes.copying import _unpack
from twin.base.errors import InfrastructureError, UsageError


class Session:
    """A web socket of the client that gives what a pod says, in parts."""

    def __init__(self, out: bytes, errors: bytes = b"", code=0, part: int = 1000) -> None:
        """``code``: what the command ends with, or what is raised instead where it is asked for;
        an exception that it breaks off with, when all parts are read."""
        self.parts = [out[at : at + part] for at in range(0, len(out), part)]
        self.errors = [errors] if errors else []
        self.code = code
        self.closed = False

    def is_open(self):
        return bool(self.parts or self.errors) or isinstance(self.code, (OSError, Lost))

    def update(self, timeout):
        assert self.is_open(), "asked again though it has ended"
        raise self.code

    @property
    def returncode(self):
        assert not self.is_open()
        if isinstance(self.code, Exception):
            raise self.code
        return self.code

    def peek_stdout(self):
        return bool(self.parts)

    def read_stdout(self):
        return self.parts.pop(0)

    def peek_stderr(self):
        return bool(self.errors)

    def read_stderr(self):
        return self.errors.pop()

    def close(self):
        self.closed = True


class Namespace:
    """Of the API only what a copy asks."""

    def __init__(self, session):
        self.session = session

    def exec(self, pod, container, command):
        assert command[:3] == ["tar", "-C", "/work/run"]
        assert "--exclude=./conductor.json" in command
        return self.session


def archive(*members):
    held = io.BytesIO()
    with tarfile.open(fileobj=held, mode="w") as made:
        for name, content, kind in members:
            member = tarfile.TarInfo(name)
            member.type, member.mode = kind, 0o4777
            if kind == tarfile.REGTYPE:
                member.size = len(content)
                made.addfile(member, io.BytesIO(content))
            else:
                member.linkname = content
                made.addfile(member)
    return held.getvalue()


FILE = tarfile.REGTYPE


def unpacked(target, data, errors=b"", code=0, container="reader"):
    session = Session(data, errors, code)
    try:
        _unpack(Namespace(session), "pod-1", container, target)
    finally:
        assert session.closed
    return sorted(str(path.relative_to(target)) for path in target.rglob("*"))


def test_files_and_folders(tmp_path):
    data = archive(("./cases", "", tarfile.DIRTYPE), ("./cases/a.txt", b"a" * 5000, FILE))
    assert unpacked(tmp_path, data) == ["cases", "cases/a.txt"]
    assert (tmp_path / "cases/a.txt").read_bytes() == b"a" * 5000
    assert not (tmp_path / "cases/a.txt").stat().st_mode & 0o7022


@pytest.mark.parametrize("name", ["../outside.txt", "/etc/outside.txt", "a/../../outside.txt"])
def test_names_that_lead_out(tmp_path, name):
    target = tmp_path / "run"
    target.mkdir()
    with contextlib.suppress(UsageError):
        unpacked(target, archive((name, b"x", FILE)))
    assert not (tmp_path / "outside.txt").exists()
    assert [path for path in tmp_path.rglob("outside.txt") if target not in path.parents] == []


@pytest.mark.parametrize("kind", [tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.FIFOTYPE, b"3"])
def test_links_pipes_and_devices_are_left_out(tmp_path, kind):
    data = archive(("strange", "/etc/passwd", kind), ("good", b"x", FILE))
    assert unpacked(tmp_path, data) == ["good"]


def test_a_name_that_leads_out_is_no_copy_that_broke_off(tmp_path):
    with pytest.raises(UsageError, match=r"leads out of .*\(\.\./a\\nb\)") as caught:
        unpacked(tmp_path, archive(("../a\nb", b"x", FILE)))
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(
    "name",
    [
        *("./job.id", "job.id", "/job.id", "./cases/../job.id", "././JOB.ID"),
        *("./job.yaml", "./conductor.json", "./conductor.owner", "./.part.tmp"),
        *("./keys/worker.key", "./spool/a", "./rigs/a"),
    ],
)
def test_what_this_machine_says_is_not_replaced(tmp_path, name):
    """Results are taken from a claim, but not which job, conductor or keys to believe."""
    data = archive(("./cases", "", tarfile.DIRTYPE), (name, b"theirs", FILE), ("good", b"x", FILE))
    assert unpacked(tmp_path, data) == ["cases", "good"]


def test_names_below_other_folders_are_not_ours(tmp_path):
    assert unpacked(tmp_path, archive(("./cases/rigs/job.id", b"x", FILE)))[-1] == (
        "cases/rigs/job.id"
    )


def test_too_much(tmp_path, monkeypatch):
    data = archive(*((f"f{n}", b"x", FILE) for n in range(4)))
    monkeypatch.setattr(hpc.kubernetes.copying, "FILES_MAX", 3)
    with pytest.raises(UsageError, match="more than 3 files"):
        unpacked(tmp_path, data)
    monkeypatch.setattr(hpc.kubernetes.copying, "PULL_BYTES_MAX", 2)
    with pytest.raises(UsageError, match="or 2 bytes"):
        unpacked(tmp_path, data)


def test_a_copy_that_breaks_off(tmp_path):
    data = archive(("a", b"x" * 3000, FILE))
    with pytest.raises(InfrastructureError, match=r"copy out of pod pod-1 broke off") as caught:
        unpacked(tmp_path, data[:2000])
    assert len(str(caught.value).splitlines()) == 1
    with pytest.raises(InfrastructureError, match="tar: /work/run: Cannot open"):
        unpacked(tmp_path, b"", b"tar: /work/run: Cannot open\n")


def test_all_that_came_is_not_all_there_is(tmp_path):
    """An archive can end where a member does, with or without its end."""
    whole = archive(("a", b"x" * 512, FILE), ("b", b"y", FILE))
    broke_off = r"copy out of pod pod-1 broke off: the connection ended before tar did"
    # The client reads a status that is not there; one of the node has no exit code.
    for code in (TypeError("None"), KeyError("details")):
        for data in (whole, whole[:1024]):
            with pytest.raises(InfrastructureError, match=broke_off):
                unpacked(tmp_path, data, code=code)
    for code in (Lost("closed"), ConnectionResetError()):
        with pytest.raises(InfrastructureError, match="broke off: the connection is lost"):
            unpacked(tmp_path, whole[:1024], code=code)
    with pytest.raises(InfrastructureError, match=r"broke off: tar: \./b: Cannot open"):
        unpacked(tmp_path, whole, b"tar: ./b: Cannot open: Permission denied\n", code=2)
    with pytest.raises(InfrastructureError, match=r"broke off: \\x1b\[2Jtar; the same"):
        unpacked(tmp_path, whole, b"more\n\x1b[2Jtar\n", code=2)
    with pytest.raises(InfrastructureError, match="broke off: tar ended with 137"):
        unpacked(tmp_path, whole, code=137)


def test_files_change_only_beside_a_conductor_that_works(tmp_path):
    said = (archive(("a", b"x", FILE)), b"tar: ./a: file changed as we read it\n")
    assert unpacked(tmp_path, *said, code=1, container="conductor") == ["a"]
    with pytest.raises(InfrastructureError, match="file changed as we read it"):
        unpacked(tmp_path, *said, code=1)
