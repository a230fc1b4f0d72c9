"""No process, socket, shared memory or temporary file outlives a run, however it ends."""

import signal

import psutil
import pytest
from processes import committed, interrupt, outcomes, suspended, wait_for


def start(marked, folder, *options):
    """A run of chaos-16 in the background, past its third case."""
    child = marked.start(
        *("conductor", "run", "chaos-16", "--workers", "2", "--out", str(folder), *options)
    )
    wait_for(lambda: committed(folder) >= 3, "three cases")
    return child


def test_listens_on_loopback_only(marked, tmp_path):
    child = start(marked, tmp_path / "c")
    addresses = set()
    with suspended(marked.processes("sim")):  # so that the run does not end meanwhile
        for process in marked.processes():
            try:
                for connection in process.net_connections("inet"):
                    if connection.status == psutil.CONN_LISTEN or not connection.raddr:
                        addresses.add(connection.laddr.ip)
            except psutil.NoSuchProcess:
                continue
        # While everything is there: each worker's stack is the one that it had load ahead.
        assert len(marked.processes("devkit", "host", "--connect", "-")) == 2
        assert len(marked.processes("devkit", "host")) == 2
    assert addresses == {"127.0.0.1"}
    child.communicate()


def test_after_a_kill(marked, tmp_path):
    """The fixture ``marked`` looks for what is left; here everything must end by itself.

    Other victims than the run itself are those of test_same_verdicts.py.
    """
    child = start(marked, tmp_path / "c")
    marked.one("run").kill()
    child.communicate()
    assert child.returncode == -signal.SIGKILL
    wait_for(lambda: not marked.processes(), "the end of every process")


def test_ctrl_c_and_resume(marked, quiet, tmp_path):
    folder = tmp_path / "c"
    child = start(marked, folder)
    interrupt(child)
    _, err = child.communicate()
    assert child.returncode == 130
    assert "Traceback" not in err
    assert "the same command goes on" in err
    assert not marked.processes()
    before = {name for name, row in outcomes(folder).items() if row["outcome"]}
    assert before
    times = {name: kpi(folder, name).stat().st_mtime_ns for name in before}
    one = ("--workers", "1", "--slots", "4")
    again = marked.run("conductor", "run", "chaos-16", "--out", str(folder), *one)
    assert again.returncode == 1, again.stderr
    assert "going on" in again.stderr
    assert quiet["fingerprint"] in again.stdout
    assert times == {name: kpi(folder, name).stat().st_mtime_ns for name in before}
    finished = marked.run("conductor", "run", "chaos-16", "--out", str(folder))
    assert finished.returncode == 1
    assert "have ended already" in finished.stderr
    assert quiet["fingerprint"] in finished.stdout


def kpi(folder, case):
    """KPI file of the committed attempt."""
    return folder / outcomes(folder)[case]["attempt_dir"] / "kpi.parquet"


@pytest.mark.parametrize("moment", ["conductor.json", "logs/worker-1.log"])
def test_ctrl_c_during_start(marked, tmp_path, moment):
    folder = tmp_path / "c"
    # A single case, since what is in the way is the start.
    case = "yolov3-0500-heavy_rain"
    command = ("conductor", "run", "chaos-16", "--case", case, "--out", str(folder))
    child = marked.start(*command)
    wait_for(lambda: (folder / moment).exists(), moment)
    interrupt(child)
    _, err = child.communicate()
    assert child.returncode == 130
    assert "Traceback" not in err
    again = marked.run(*command)
    assert again.returncode == 1, again.stderr
    assert len(outcomes(folder)) == 1


def test_sigterm_of_a_worker_gives_its_cases_back(marked, tmp_path):
    folder = tmp_path / "c"
    child = start(marked, folder)
    marked.one("worker").terminate()
    child.communicate()
    assert child.returncode == 1
    rows = outcomes(folder)
    assert len(rows) == 16
    assert all(row["charges"] == [] for row in rows.values())
