"""What a process in a sandbox can see, write, reach and start; real bubblewrap, real kernel."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import tempfile
import textwrap
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest
from waiting import PATIENCE_S, wait_for

from conductor.run.gpu_turns import turns
from twin.base.gpu.first_use import PLACE_VARIABLE, TURNS_VARIABLE
from twin.base.process import end
from twin.sandbox.possible import why_not
from twin.sandbox.reads import python_reads, stack_reads
from twin.sandbox.start import Sandboxed, own_code, spawn_inside
from twin.sandbox.view import SCRATCH, SCRATCH_BYTES_MAX, SandboxView
from twin.worker.protection import protection

pytestmark = pytest.mark.skipif(bool(why_not()), reason=why_not())


def inside(code, *words, readable=(), folder=SCRATCH, **changed):
    """What ``code`` prints as JSON when it runs in a sandbox."""
    view = SandboxView(readable=[*python_reads(), *readable], folder=folder, **changed)
    head = "import json, os, socket, sys\nfrom pathlib import Path\n"
    command = [sys.executable, "-c", head + textwrap.dedent(code), *map(str, words)]
    with Sandboxed(command, view) as box:
        done = subprocess.run(
            box.words,
            env=box.environment,
            pass_fds=box.descriptors,
            capture_output=True,
            text=True,
            stdin=subprocess.DEVNULL,
            timeout=PATIENCE_S,
        )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_files_of_others_do_not_exist(tmp_path, monkeypatch):
    """Home, temporary files, run folders, password files, sockets of services."""
    secret = tmp_path / "authority.key"
    secret.write_text("secret")
    places = [secret, Path.home(), "/etc/shadow", "/run", "/var", "/work/nothing", "/root/.bashrc"]
    found = inside("print(json.dumps([Path(p).exists() for p in sys.argv[1:]]))", *places)
    # A home folder may hold this Python, and then exists without anything else.
    assert [seen for place, seen in zip(places, found, strict=True) if place != Path.home()] == (
        [False] * (len(places) - 1)
    )


def test_secrets_of_the_environment_stay_outside(monkeypatch):
    for name in (
        "AWS_SECRET_ACCESS_KEY",
        "GITHUB_TOKEN",
        "TWIN_KEY",
        "SSH_AUTH_SOCK",
        "KAGGLE_KEY",
    ):
        monkeypatch.setenv(name, "secret")
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    monkeypatch.setenv("LC_NAME", "here")
    look = "print(json.dumps([dict(os.environ), Path('/proc/1/environ').read_text()]))"
    variables, first = inside(look, variables={"GIVEN": "1"})
    assert "secret" not in variables.values()
    assert "secret" not in first
    assert {variables[name] for name in ("OMP_NUM_THREADS", "LC_NAME", "GIVEN")} == {
        "3",
        "here",
        "1",
    }
    assert variables["HOME"] == variables["TMPDIR"] == str(SCRATCH)


def test_what_it_reads_is_read_only_and_what_it_writes_is_gone_and_bounded(tmp_path):
    code = tmp_path / "code"
    code.mkdir()
    (code / "data.txt").write_text("mine")
    work = tmp_path / "work"
    work.mkdir()
    (work / "old.txt").write_text("of somebody")
    found = inside(
        """
        said = {"data": Path(sys.argv[1], "data.txt").read_text(), "here": os.listdir(".")}
        for place in (sys.argv[1], "/", "/usr", "/dev", "/etc"):
            try:
                Path(place, "x").write_text("x")
                said[place] = "written"
            except OSError as error:
                said[place] = error.strerror
        for place in (".", "/tmp", "/dev/shm"):
            written = 0
            try:
                with open(Path(place, "big"), "wb") as file:
                    while written < 600_000_000:
                        written += file.write(bytes(1_000_000))
            except OSError as error:
                pass
            said[place] = written
        print(json.dumps(said))
        """,
        *(code,),
        readable=[code],
        folder=work,
    )
    assert found["data"] == "mine"
    assert found["here"] == []
    assert {found[p] for p in (str(code), "/", "/usr", "/dev", "/etc")} == {"Read-only file system"}
    assert max(found[place] for place in (".", "/tmp", "/dev/shm")) <= SCRATCH_BYTES_MAX
    assert sorted(path.name for path in tmp_path.rglob("*")) == [
        *("code", "data.txt", "old.txt", "work")
    ]


def test_run_folders_in_what_it_reads_stay_hidden(tmp_path):
    run = tmp_path / "runs/mine"
    run.mkdir(parents=True)
    (run / "conductor.db").write_text("x")
    (tmp_path / "stack.py").write_text("x")
    look = "print(json.dumps(sorted(str(p) for p in Path(sys.argv[1]).rglob('*'))))"
    assert inside(look, tmp_path, readable=[tmp_path], hidden=[run]) == [
        *(str(tmp_path / name) for name in ("runs", "runs/mine", "stack.py"))
    ]


def test_no_port_no_abstract_socket_and_no_shared_memory_of_the_host():
    with (
        socket.create_server(("127.0.0.1", 0)) as server,
        socket.socket(socket.AF_UNIX) as abstract,
    ):
        name = f"\0sandbox-{os.getpid()}"
        abstract.bind(name)
        abstract.listen()
        with tempfile.NamedTemporaryFile(dir="/dev/shm") as shared:
            found = inside(
                """
                said = []
                for family, place in (
                    (socket.AF_INET, ("127.0.0.1", int(sys.argv[1]))),
                    (socket.AF_UNIX, "\\0" + sys.argv[2]),
                ):
                    try:
                        socket.socket(family).connect(place)
                        said.append("connected")
                    except OSError as error:
                        said.append(error.strerror)
                own = socket.create_server(("127.0.0.1", 0))
                socket.create_connection(own.getsockname())
                names = [name for _, name in socket.if_nameindex()]
                print(json.dumps([*said, names, os.listdir("/dev/shm")]))
                """,
                *(server.getsockname()[1], name[1:]),
            )
            assert Path(shared.name).exists()
    assert found == ["Connection refused", "Connection refused", ["lo"], []]


def test_no_process_of_others_is_seen_signalled_or_traced():
    other = subprocess.Popen(["sleep", "600"])
    try:
        found = inside(
            """
            import ctypes, signal
            libc = ctypes.CDLL(None, use_errno=True)
            def call(name, *given):
                ctypes.set_errno(0)
                return [getattr(libc, name)(*given), ctypes.get_errno()]
            said = {"kill": call("kill", int(sys.argv[1]), 9)}
            said["ptrace"] = call("ptrace", 16, 1, 0, 0)
            said["unshare"] = call("unshare", 0x10000000)
            said["mount"] = call("mount", b"x", b"/tmp", b"tmpfs", 0, 0)
            for name, number in (("keyctl", 250), ("bpf", 321), ("io_uring", 425), ("clone3", 435)):
                said[name] = call("syscall", number, 0, 0, 0, 0)
            said["clone"] = call("syscall", 56, 0x10000000 | 17, 0, 0, 0, 0)
            said["caps"] = [
                line.split()[1]
                for line in Path("/proc/self/status").read_text().splitlines()
                if line.startswith(("CapEff", "CapBnd", "NoNewPrivs", "Seccomp:"))
            ]
            said["seen"] = sorted(name for name in os.listdir("/proc") if name.isdigit())
            signal.signal(signal.SIGTERM, signal.SIG_IGN)
            said["all"] = call("kill", -1, 15)[0]
            print(json.dumps(said))
            """,
            other.pid,
        )
        assert other.poll() is None
    finally:
        other.kill()
        other.wait()
    assert found["kill"] == [-1, 3]
    assert found["seen"] == ["1", "2"]
    assert found["caps"] == ["0000000000000000", "0000000000000000", "1", "2"]
    assert [found[name] for name in ("ptrace", "unshare", "mount")] == [[-1, 1]] * 3
    if os.uname().machine == "x86_64":
        assert [found[name] for name in ("keyctl", "bpf", "io_uring", "clone")] == [[-1, 1]] * 4
        assert found["clone3"] == [-1, 38]


TAKE = """
import ctypes, json, os, socket, sys
pid, descriptor = map(int, sys.argv[1:])
path, said = f"/proc/{pid}/fd/{descriptor}", []
for attempt in (
    lambda: os.readlink(path),
    lambda: os.open(path, os.O_PATH),
    lambda: socket.socket(socket.AF_UNIX).connect(path),
):
    try:
        attempt()
        said.append("done")
    except OSError as error:
        said.append(error.strerror)
taken = ctypes.CDLL(None).syscall(438, os.pidfd_open(pid), descriptor, 0)
print(json.dumps([*said, taken >= 0]))
"""
"""Ways to a socket without a name that another process has open."""


def test_no_open_file_of_a_process_that_it_sees():
    """On a GPU processes of the host are seen, also such as do not keep to themselves."""
    with socket.socket(socket.AF_UNIX) as listener, tempfile.TemporaryDirectory() as short:
        listener.bind(f"{short}/worker")
        listener.listen()
        descriptor = os.open(f"{short}/worker", os.O_PATH | os.O_CLOEXEC)
        (Path(short) / "worker").unlink()
        holder = subprocess.Popen(["sleep", "600"], pass_fds=[descriptor])
        try:
            words = [holder.pid, descriptor]
            outside = [sys.executable, "-c", TAKE, *map(str, words)]
            done = subprocess.run(outside, capture_output=True, text=True, check=True)
            seen = inside(TAKE, *words, shared=["processes", "ipc"])
        finally:
            holder.kill()
            holder.wait()
            os.close(descriptor)
    assert json.loads(done.stdout)[:3] == ["done", "done", "done"], "without a sandbox"
    assert seen == [*["Permission denied"] * 3, False]


@contextmanager
def started(code):
    """A process in a sandbox that runs ``code``, and its log."""
    view = SandboxView(readable=python_reads(), folder=SCRATCH)
    with tempfile.TemporaryFile() as log:
        child = spawn_inside([sys.executable, "-uc", code], view, log)
        try:
            yield child, log
        finally:
            end(child)


def sleeps(box):
    """Whether a command of the test runs in the sandbox."""
    return any(each.cmdline() == ["sleep", "614"] for each in box.children(recursive=True))


def test_nothing_that_it_started_outlives_it():
    """Also what left its session and whose parent has ended, and whoever is killed."""
    code = """
import os, sys, time
if os.fork() == 0:
    os.setsid()
    if os.fork() == 0:
        os.execvp("sleep", ["sleep", "614"])
    os._exit(0)
os.wait()
print("ready")
sys.stdin.read()
"""
    for way in ("lifeline", "kill"):
        with started(code) as (child, log):
            wait_for(lambda log=log: os.fstat(log.fileno()).st_size, "its start")
            box = psutil.Process(child.pid)
            wait_for(lambda box=box: sleeps(box), "the start of what stays behind")
            below = box.children(recursive=True)
            child.stdin.close() if way == "lifeline" else child.kill()
            child.wait(PATIENCE_S)
            gone, alive = psutil.wait_procs(below, PATIENCE_S)
            assert (len(gone), alive) == (len(below), [])


@pytest.mark.parametrize(
    ("code", "expected"),
    [("import sys; sys.exit(7)", 7), ("import os; os.kill(os.getpid(), 9)", -9), ("pass", 0)],
)
def test_how_it_ended_is_told_as_without(code, expected):
    with started(code) as (child, _):
        assert own_code(child, child.wait(PATIENCE_S)) == expected


def test_it_takes_on_limits_that_it_cannot_raise():
    found = inside(
        """
        import resource
        from twin.sandbox.inside import LIMITS, limit_self
        limit_self()
        said = [resource.getrlimit(limit)[1] for limit in LIMITS] == list(LIMITS.values())
        try:
            resource.setrlimit(resource.RLIMIT_NOFILE, (10**6, 10**6))
        except ValueError as error:
            print(json.dumps([said, str(error)]))
        """
    )
    assert found == [True, "not allowed to raise maximum limit"]


def test_a_stack_is_read_with_its_package_and_what_the_campaign_names(tmp_path, monkeypatch):
    for name in ("mystack/__init__.py", "mystack/data/curve.csv", "beside.py", "other/secret.py"):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("import beside\n" if name == "mystack/__init__.py" else "")
    (tmp_path / "gains.json").write_text("{}")
    monkeypatch.chdir(tmp_path)
    named = {"gains": "gains.json", "speed": 5.0, "mode": "fast"}
    assert stack_reads("mystack:Stack", None, [str(tmp_path / "other")], named, ["/m/a.onnx"]) == [
        Path("/m/a.onnx"),
        *(tmp_path / name for name in ("beside.py", "gains.json", "mystack", "other")),
    ]


def test_a_stack_on_a_gpu_takes_its_turn_to_begin_and_one_on_a_cpu_sees_none(tmp_path, monkeypatch):
    monkeypatch.setenv(PLACE_VARIABLE, "7")
    code = """
    import contextlib
    path = os.environ.get("TWIN_GPU_TURNS")
    with socket.socket(socket.AF_UNIX) as queue, contextlib.suppress(TypeError):
        queue.connect(path)
        queue.sendall(os.environ["TWIN_GPU_PLACE"].encode() + b"\\n")
        path = queue.recv(1).decode()
    print(json.dumps(path))
    """
    with turns("cuda:0"):
        folder = Path(os.environ[TURNS_VARIABLE]).parent
        on_gpu, on_cpu = (protection(None, device, tmp_path).view for device in ("cuda:0", "cpu"))
        assert folder in on_gpu.readable
        assert folder not in on_cpu.readable
        assert "network" not in on_gpu.shared
        names = ("shared", "device", "variables")
        for view, said in ((on_gpu, "\n"), (on_cpu, None)):
            changed = {name: getattr(view, name) for name in names}
            assert inside(code, readable=view.readable, **changed) == said
