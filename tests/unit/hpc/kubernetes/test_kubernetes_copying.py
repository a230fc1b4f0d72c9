"""What arrives from a pod is a stranger's archive."""

import contextlib
import io
import tarfile

import pytest

import hpc.kubernetes.copying
from hpc.kubernetes.copying import _unpack
from twin.base.errors import InfrastructureError, UsageError


class Session:
    """A web socket of the client that gives what a pod says, in parts."""

    def __init__(self, out: bytes, errors: bytes = b"", part: int = 1000) -> None:
        self.parts = [out[at : at + part] for at in range(0, len(out), part)]
        self.errors = [errors] if errors else []
        self.closed = False

    def is_open(self):
        return bool(self.parts or self.errors)

    def update(self, timeout):
        raise AssertionError("asked again though it has ended")

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


def unpacked(target, data, errors=b""):
    session = Session(data, errors)
    try:
        _unpack(Namespace(session), "pod-1", "reader", target)
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
    with contextlib.suppress(InfrastructureError):
        unpacked(target, archive((name, b"x", FILE)))
    assert not (tmp_path / "outside.txt").exists()
    assert [path for path in tmp_path.rglob("outside.txt") if target not in path.parents] == []


@pytest.mark.parametrize("kind", [tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.FIFOTYPE, b"3"])
def test_links_pipes_and_devices_are_left_out(tmp_path, kind):
    data = archive(("strange", "/etc/passwd", kind), ("good", b"x", FILE))
    assert unpacked(tmp_path, data) == ["good"]


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
