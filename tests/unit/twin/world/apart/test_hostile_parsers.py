"""twin.world.apart: a parser that a file has taken over reaches nothing, and lies in vain."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import hostile_parsers
import psutil
import pytest
from hostile_parsers import MESH_DATA, triangle
from waiting import wait_for

from twin.sandbox.possible import why_not
from twin.world.apart import reading
from twin.world.apart.checks import pack
from twin.world.apart.frames import write_frame
from twin.world.apart.reading import AskedFile, read_apart
from twin.world.meshes.mesh_file import MeshData

HERE = [Path(hostile_parsers.__file__)]

sandboxed = pytest.mark.skipif(bool(why_not()), reason=why_not() or "there is a sandbox")


def parsed(tmp_path: Path, parser: str, order: str = "", **options: float) -> object:
    """What a parser answers of a file with this order."""
    path = tmp_path / "order.obj"
    path.write_text(order)
    asked = [AskedFile(f"hostile_parsers:{parser}", path)]
    (found,) = read_apart(asked, readable=HERE, **options)
    return found


def refused(tmp_path: Path, parser: str, order: str = "", **options: float) -> str:
    """The line about the file."""
    with pytest.raises(ValueError) as caught:
        parsed(tmp_path, parser, order, **options)
    line = str(caught.value)
    assert line.startswith(f"{tmp_path}/order.obj: "), line
    assert line.isprintable()
    assert len(line) <= 1000
    return line


@sandboxed
@pytest.mark.parametrize("place", ["beside", "/etc/shadow", "/etc/machine-id"])
def test_other_files_are_not_there(tmp_path: Path, place: str) -> None:
    secret = tmp_path / "secret"
    secret.write_text("a word")
    line = refused(tmp_path, "READ", str(secret) if place == "beside" else place)
    assert "No such file" in line


def test_its_own_file_and_what_that_names_are_there(tmp_path: Path) -> None:
    other = tmp_path / "other.mtl"
    other.write_text("a library")
    path = tmp_path / "order.obj"
    path.write_text(str(other))
    asked = [AskedFile("hostile_parsers:READ", path, [other])]
    assert list(read_apart(asked, readable=HERE)) == ["a library"]


@pytest.mark.parametrize("place", ["beside", "/tmp/drivetwin-taken-over", "itself"])
def test_nothing_is_written(tmp_path: Path, place: str) -> None:
    beside = tmp_path / "beside"
    named = {"beside": beside, "itself": tmp_path / "order.obj"}.get(place, Path(place))
    try:
        refused(tmp_path, "WRITE", str(named))
        # Without a sandbox an empty file may be made, and an old one emptied.
        sizes = [path.stat().st_size for path in (beside, named) if path.exists()]
        assert max(sizes, default=0) <= (len(str(named)) if place == "itself" else 0)
        if not why_not():
            assert (tmp_path / "order.obj").read_text() == str(named)
            assert not beside.exists()
    finally:
        Path("/tmp/drivetwin-taken-over").unlink(missing_ok=True)


@sandboxed
def test_nobody_is_reached(tmp_path: Path) -> None:
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        listener.settimeout(0)
        line = refused(tmp_path, "CONNECT", f"127.0.0.1:{listener.getsockname()[1]}")
        assert "refused" in line or "unreachable" in line
        with pytest.raises(BlockingIOError):
            listener.accept()


@sandboxed
def test_no_process_is_ended_or_left_behind(tmp_path: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as neighbour:
        assert "No such process" in refused(tmp_path, "END", str(neighbour.pid))
        assert neighbour.poll() is None
    before = set(_children())
    try:
        parsed(tmp_path, "START")  # root may start processes; they end with the sandbox
    except ValueError:
        pass
    wait_for(lambda: set(_children()) <= before, "its end, and that of others' that end just now")


def _children() -> list[int]:
    """Processes that parse for this process, or that nobody waits for any more; those of tests that
    run beside this one have this one's parent above them."""
    parsing = []
    for process in psutil.process_iter():
        with suppress(psutil.Error):
            if "twin.world.apart.child" in " ".join(process.cmdline()):
                above = {parent.pid for parent in process.parents()}
                if os.getpid() in above or os.getppid() not in above:
                    parsing.append(process.pid)
    return parsing


@pytest.mark.slow
def test_memory_and_time_have_an_end(tmp_path: Path) -> None:
    assert "not enough memory" in refused(tmp_path, "ALLOCATE")
    assert "not done after 1 s of processor time" in refused(tmp_path, "SPIN", cpu_s=1)
    assert "not done in time" in refused(tmp_path, "SLEEP", wall_s=5.0)


@pytest.mark.parametrize(
    ("parser", "words"),
    [
        ("CRASH", "its reader ended (killed by SIGSEGV)"),
        ("LEAVE", "its reader ended (exit code 0)"),
        ("RAISE", "KeyError"),
    ],
)
def test_a_parser_without_an_answer_is_one_line(tmp_path: Path, parser: str, words: str) -> None:
    assert words in refused(tmp_path, parser)


def test_what_a_parser_prints_is_no_answer(tmp_path: Path) -> None:
    assert parsed(tmp_path, "CHATTER") == "chattered"


def frame(head: bytes, rest: bytes = b"") -> str:
    """Hexadecimal bytes of a frame."""
    return (len(head).to_bytes(4, "little") + head + rest).hex()


@pytest.mark.parametrize(
    ("order", "words"),
    [
        ("ff" * 4, "a head of 4294967295 bytes"),
        ("41" * 40, "a head of"),
        (frame(b"[1, 2]"), "a head that cannot be read"),
        (frame(b"[" * 100_000), "a head that cannot be read"),
        (frame(b'{"tree": 7}'), "answer is not as declared"),
        (frame(b'{"tree": null}'), "answer is missing"),
        (frame(b'{"arrays": [["object", [1]]]}'), "a type or shape that is not read"),
        (frame(b'{"arrays": [["float64", [-1]]]}'), "a type or shape that is not read"),
        (frame(b'{"arrays": [["float64", [99999999999999]]]}'), "more bytes than may be"),
        (frame(b'{"arrays": [["float64", [400000000]]]}', b"\0" * 999), "its reader ended"),
        (frame(b'{"error": "no \\u001b[2J\\nfile"}'), "no \\x1b[2J\\nfile"),
    ],
)
def test_a_forged_answer_is_refused(tmp_path: Path, order: str, words: str) -> None:
    with pytest.raises(ValueError) as caught:
        parsed(tmp_path, "FORGE", order)
    assert words in str(caught.value)
    assert str(caught.value).isprintable()


@pytest.mark.parametrize(
    ("lie", "words"),
    [
        ("index", "faces names what is not there"),
        ("negative", "faces names what is not there"),
        ("nan", "points holds NaN"),
        ("uv-nan", "uv holds NaN"),
        ("flat", "points of type float64, shape [3, 2]"),
        ("type", "faces of type int32"),
        ("short", "faces of type int64, shape [1, 3]: not as declared"),
        ("uv-long", "uv of type float64, shape [9, 2]"),
        ("missing", "faces is missing"),
        ("picture", "image of type uint8, shape [1, 4096, 3]"),
        ("pixels", "image of type uint8, shape [0, 4, 3]"),
        ("note", "notes is not as declared"),
        ("notes", "notes is no list of 0 to"),
        ("no-parts", "parts is no list of 1 to"),
    ],
)
def test_a_mesh_that_is_not_as_declared_is_refused(tmp_path: Path, lie: str, words: str) -> None:
    assert words in refused(tmp_path, "LIE", lie)


def test_a_true_answer_written_by_hand_is_taken(tmp_path: Path) -> None:
    """The forged ones above are refused for what is in them, not for their form."""
    sent = bytearray()
    write_frame(sent.extend, *pack(MeshData([triangle()]), MESH_DATA))
    path = tmp_path / "order.obj"
    path.write_text(sent.hex())
    (found,) = read_apart([AskedFile("hostile_parsers:TRUE", path)], readable=HERE)
    assert found.parts[0].faces.tolist() == [[0, 1, 2]]


@pytest.mark.slow
def test_the_limits_hold_without_a_sandbox(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(reading, "why_not", lambda: "none here")
    assert "File too large" in refused(tmp_path, "WRITE", str(tmp_path / "beside"))
    assert "not enough memory" in refused(tmp_path, "ALLOCATE")
    assert "1 s of processor time" in refused(tmp_path, "SPIN", cpu_s=1)
    assert "its reader ended (killed by SIGSEGV)" in refused(tmp_path, "CRASH")
    assert reading.unprotected() == "meshes and heightmaps are read without a sandbox: none here"
