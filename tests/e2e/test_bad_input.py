"""Bad input and bad surroundings: one clear line, a documented exit code, nothing lost."""

import os
import signal
import socket
import subprocess
from pathlib import Path

import pytest
from processes import catches, committed, outcomes, wait_for


def one_line(done, code, *words):
    """The command failed with ``code`` and one line that holds ``words``."""
    assert done.returncode == code, (done.stdout, done.stderr)
    lines = done.stderr.strip().splitlines()
    assert len(lines) == 1, done.stderr
    for word in words:
        assert word in lines[0]


def campaign_file(folder: Path, **changes) -> Path:
    """A small campaign with changes to its top level."""
    import yaml

    data = {"campaign": "c", "matrix": {"weather": ["clear"]}, **changes}
    path = folder / "c.yaml"
    path.write_text(yaml.safe_dump(data))
    return path


def test_unknown_campaign(marked):
    one_line(marked.run("conductor", "run", "aeb-dmo"), 2, "did you mean 'aeb-demo'?")


def test_missing_file(marked):
    one_line(marked.run("conductor", "run", "no/such.yaml"), 2, "no/such.yaml", "no such file")


def test_a_file_in_place_of_the_folder(marked, tmp_path):
    """It is not the machine's fault."""
    file = tmp_path / "notes"
    file.write_text("mine")
    for out in (file, file / "below"):
        done = marked.run("conductor", "run", "chaos-16", "--out", str(out))
        one_line(done, 2, str(out), "a file is where a folder should be")
    assert file.read_text() == "mine"


def test_unknown_weather(marked, tmp_path):
    path = campaign_file(tmp_path, matrix={"weather": ["hevy_fog"]})
    done = marked.run("conductor", "run", str(path), "--out", str(tmp_path / "out"))
    one_line(done, 2, "matrix.weather", "'hevy_fog'", "did you mean 'heavy_fog'?")
    assert not (tmp_path / "out").exists()


def test_port_in_use(marked, tmp_path):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        out = tmp_path / "c"
        done = marked.run("conductor", "run", "chaos-16", "--listen", endpoint, "--out", str(out))
        one_line(done, 2, endpoint[4:], "already in use")
        assert not out.exists()
        # Nor by a conductor that would make keys first.
        tls = f"tls{endpoint[3:]}"
        done = marked.run("conductor", "serve", "--listen", tls, "--state", str(out))
        one_line(done, 2, tls, "already in use")
        assert not out.exists()
    done = marked.run("conductor", "serve", "--listen", "tls/192.0.2.1:7447", "--state", str(out))
    one_line(done, 2, "tls/192.0.2.1:7447: cannot listen: Cannot assign requested address")
    assert not out.exists()


def test_unreachable_conductor(marked):
    done = marked.run("conductor", "status", "--insecure", "--connect", "tcp/127.0.0.1:1")
    one_line(done, 3, "tcp/127.0.0.1:1", "nobody answers")


def test_worker_without_a_conductor(marked, tmp_path):
    one_line(marked.run("twin", "worker"), 2, "--connect", "--state")
    done = marked.run("twin", "worker", "--state", str(tmp_path))
    one_line(done, 2, "conductor.json", "conductor serve")
    there = ("--insecure", "--connect", "tcp/127.0.0.1:1", "--wait", "0.1")
    one_line(marked.run("twin", "worker", *there), 3, "tcp/127.0.0.1:1: no conductor answers")
    done = marked.run("twin", "worker", *there, "--started-again", "--until-done")
    one_line(done, 75, "tcp/127.0.0.1:1: no conductor answers", "may start it again")


def test_bad_endpoint(marked):
    done = marked.run("conductor", "status", "--connect", "localhost")
    one_line(done, 2, "localhost", "tcp/HOST:PORT")


@pytest.mark.parametrize("device", ["gpu", "cuda", "cuda:999"])
def test_a_device_that_is_not_here(marked, tmp_path, device):
    out = tmp_path / "out"
    done = marked.run("conductor", "run", "chaos-16", "--device", device, "--out", str(out))
    one_line(done, 2, f"'{device}'", "cpu")
    assert not out.exists()
    done = marked.run("twin", "worker", "--device", device, "--connect", "tcp/127.0.0.1:1")
    one_line(done, 2, f"'{device}'", "cpu")


def test_another_campaign_in_the_folder(marked, tmp_path):
    command = ("conductor", "run", str(campaign_file(tmp_path, simulator="noop")), "--out")
    folder = str(tmp_path / "out")
    assert marked.run(*command, folder).returncode == 0
    one_line(marked.run(*command, folder, "--seed", "99"), 2, "other cases", folder)


def test_noop_has_no_report(marked, tmp_path):
    path = campaign_file(tmp_path, simulator="noop")
    done = marked.run("conductor", "run", str(path), "--out", str(tmp_path / "out"))
    assert done.returncode == 0, done.stderr
    assert "noop" in done.stdout
    one_line(marked.run("conductor", "report", str(tmp_path / "out")), 2, "noop")


def test_unknown_stack_parameter_fails_with_the_reason(marked, tmp_path):
    path = campaign_file(tmp_path, autonomy={"parameters": {"cruise": 3}})
    out = tmp_path / "out"
    done = marked.run("conductor", "run", str(path), "--out", str(out), "--workers", "1")
    assert done.returncode == 1
    (row,) = outcomes(out).values()
    assert (row["outcome"], row["attempts"]) == ("failed", 1)
    assert "cruise" in row["reasons"][0]


def test_no_case_passes_without_a_verdict(marked, tmp_path):
    """A stack that raises: failed, never a pass; its words reach the user."""
    package = tmp_path / "mystack.py"
    package.write_text(
        "from devkit.stack import Stack\n"
        "class Broken(Stack):\n"
        "    def reset(self, slot, episode): pass\n"
        "    def step(self, observation): raise RuntimeError('lens cap on')\n"
    )
    path = campaign_file(tmp_path, autonomy={"stack": "mystack:Broken"})
    os.environ["PYTHONPATH"] = str(tmp_path)
    try:
        done = marked.run("conductor", "run", str(path), "--out", str(tmp_path / "out"))
    finally:
        del os.environ["PYTHONPATH"]
    assert done.returncode == 1, done.stderr
    (row,) = outcomes(tmp_path / "out").values()
    assert (row["outcome"], row["attempts"]) == ("failed", 1)
    assert not row["passed"]
    assert "lens cap on" in row["reasons"][0]


def test_full_disk_then_space(marked, quiet, small_disk):
    ballast = small_disk / "ballast"
    ballast.write_bytes(bytes(700_000))
    folder = small_disk / "c"
    done = marked.run("conductor", "run", "chaos-16", "--workers", "1", "--out", str(folder))
    assert done.returncode == 3, (done.stdout, done.stderr)
    last = done.stderr.strip().splitlines()[-1]
    assert "No space left on device" in last or "full" in last
    assert "Traceback" not in done.stderr
    before = committed(folder)
    ballast.unlink()
    subprocess.run(["mount", "-o", "remount,size=40m", str(small_disk)], check=True)
    again = marked.run("conductor", "run", "chaos-16", "--workers", "1", "--out", str(folder))
    assert again.returncode == 1, again.stderr
    assert committed(folder) >= max(16, before)
    assert quiet["fingerprint"] in again.stdout


def test_foreign_package_is_named(marked, tmp_path):
    (tmp_path / "devkit").mkdir()
    (tmp_path / "devkit" / "__init__.py").write_text("")
    # The working folder comes first on the path of ``python -m``.
    done = marked.run("conductor", "campaigns", folder=tmp_path)
    one_line(done, 2, "devkit", str(tmp_path))


def test_an_interrupted_start_of_a_worker(marked, tmp_path):
    """A worker whose conductor never comes: SIGTERM ends it at once, with the code for that."""
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        child = marked.start(
            *("twin", "worker", "--insecure"),
            *("--connect", f"tcp/127.0.0.1:{silent.getsockname()[1]}"),
        )
        wait_for(lambda: catches(child.pid, signal.SIGTERM), "its first lines")
        child.terminate()
        _, err = child.communicate()
    assert child.returncode == 75
    assert "terminated; run the same command again to go on" in err


def test_reports_and_comparisons_of_nothing(marked, tmp_path):
    nothing = str(tmp_path / "nothing")
    one_line(marked.run("conductor", "compare", nothing, nothing), 2, nothing, "outcomes.json")
    one_line(marked.run("conductor", "export", nothing, "--out", nothing), 2, "outcomes.json")
    one_line(marked.run("conductor", "report"), 2, "campaign folder", "--import-autodrive")
    done = marked.run("conductor", "report", nothing, "--recordings", "all")
    one_line(done, 2, "--recordings belongs to a run in a store")
    done = marked.run("conductor", "report", "--import-autodrive", nothing, "--out", nothing)
    one_line(done, 2, "config.json", "No such file")
    assert not (tmp_path / "nothing").exists()
