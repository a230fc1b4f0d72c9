"""`import drivetwin` on real runs: the command line's results, and what goes wrong on the way."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from foreign_campaigns import campaign
from IPython.core.formatters import HTMLFormatter
from processes import Marked, complete, nothing_left, outcomes
from python_tasks import LONG, LONG_CASES, SMALL, task, written

import drivetwin


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """A campaign of two cases: its file, and its folder after a run from Python."""
    folder = tmp_path_factory.mktemp("ran")
    path = campaign(
        folder,
        "python",
        {},
        matrix={"weather": ["clear", "heavy_fog", "light_rain"]},
        cameras=[{"name": "front_left", "width": 64, "height": 36, "hz": 10}],
    )
    code = f"""
        import drivetwin
        run = drivetwin.run(
            "{path}", axes={{"weather": ["clear", "heavy_fog"]}}, out="run", workers=1,
            record_drive=True, view="record",
        )
        print(run.fingerprint.sha256)
    """
    starter = Marked()
    try:
        with nothing_left(starter):
            done = starter.run(task(folder, code), folder=folder)
    finally:
        starter.end()
    assert done.returncode == 0, done.stderr
    assert "python: 2 of 2 cases done" in done.stderr
    return path, folder / "run", done.stdout.strip()


def test_the_same_fingerprint_as_the_command_line(marked, ran, tmp_path):
    path, run, fingerprint = ran
    content = {**json.loads(path.read_text()), "matrix": {"weather": ["clear", "heavy_fog"]}}
    words = ("--out", str(tmp_path / "run"), "--workers", "1", "--output", "json", "--record-drive")
    done = marked.run("conductor", "run", str(written(tmp_path, content)), *words)
    assert json.loads(done.stdout)["fingerprint"] == fingerprint
    assert drivetwin.open(run).fingerprint.sha256 == fingerprint
    found = drivetwin.compare(run, tmp_path / "run")
    assert found.identical
    assert (found.exit_code, found.regressions) == (0, [])
    assert "identical" in repr(found)
    assert found.to_dict()["result"] == "identical"
    assert "identical" in found.to_markdown()


def test_cases_are_a_table_with_units(ran):
    run = drivetwin.open(ran[1])
    table = run.cases()
    assert table["weather"].to_pylist() == ["clear", "heavy_fog"]
    assert table.schema.field("dtc_min_m").metadata[b"unit"] == b"m"
    assert b"distance" in table.schema.field("dtc_min_m").metadata[b"doc"].lower()
    rows = outcomes(ran[1])
    for row in table.to_pylist():
        case = rows[row["case"]]
        assert row["verdict"] == case["verdict"]
        assert row["dtc_min_m"] == case["scalars"]["dtc_min_m"]
    frame = table.to_pandas()
    assert list(frame["case"]) == list(rows)
    assert run.exit_code in (0, 1)
    assert "of 2 passed" in repr(run)
    assert "of 2 passed" in in_a_notebook(run)


def test_kpis_of_a_case_over_time(ran):
    run = drivetwin.open(ran[1])
    case = run.cases()["case"][1].as_py()
    rows = run.kpis(case)
    assert rows.schema.field("speed_mps").metadata[b"unit"] == b"m/s"
    least = min(value for value in rows["dtc_m"].to_pylist() if value is not None)
    assert least >= run.cases()["dtc_min_m"][1].as_py() - 1e-9
    with pytest.raises(drivetwin.UsageError, match="no case 'fog'; allowed: ") as caught:
        run.kpis("fog")
    assert len(str(caught.value).splitlines()) == 1


def test_frames_of_every_camera_as_the_stack_saw_them(ran):
    run = drivetwin.open(ran[1])
    case = run.cases()["case"][0].as_py()
    right, left = run.frame(case, 1.0), run.frame(case, 1.0, camera="front_left")
    assert right.shape == left.shape == (36, 64, 3)
    assert str(right.dtype) == "uint8"
    assert (run.frame(case, 1.0, camera="front_right") == right).all()
    assert (right != left).any(), "another camera has another view"
    assert (run.frame(case, 1.05) == right).all(), "at 10 Hz the picture stands until 1.1 s"
    assert (run.frame(case, 2.0) != right).any()
    assert run.frame(case, "closest").shape == (36, 64, 3)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("nowhere", 1.0), "no case 'nowhere'"),
        (("{case}", 1000.0), "ends at"),
        (("{case}", "later"), "expected aeb, closest, or seconds"),
        (("{case}", float("nan")), "expected aeb, closest, or seconds"),
        (("{case}", 1.0, "roof"), "no camera 'roof'; allowed: front_right, front_left"),
    ],
)
def test_a_frame_that_is_not_there(ran, arguments, said):
    run = drivetwin.open(ran[1])
    case = run.cases()["case"][0].as_py()
    words = [word.format(case=case) if isinstance(word, str) else word for word in arguments]
    with pytest.raises(drivetwin.UsageError, match=said) as caught:
        run.frame(*words)
    assert len(str(caught.value).splitlines()) == 1


def test_frames_of_a_recording_without_a_drive_record(ran, tmp_path):
    folder = copied(ran[1], tmp_path)
    run, case = drivetwin.open(folder), drivetwin.open(folder).cases()["case"][0].as_py()
    exact = run.frame(case, 1.0).astype(int)
    for path in folder.glob("cases/*/attempt-*/drive.record"):
        path.unlink()
    lossy = run.frame(case, 1.0)
    assert 0 < abs(lossy - exact).mean() < 12, "JPEG of the same picture, in the same colours"
    assert (run.frame(case, 1.0) == lossy).all()
    with pytest.raises(drivetwin.UsageError, match="camera 'front_left' was not recorded"):
        run.frame(case, 1.0, camera="front_left")
    for path in folder.glob("cases/*/attempt-*/recording.rrd"):
        path.unlink()
    with pytest.raises(drivetwin.UsageError, match="was not recorded; run the campaign with"):
        run.frame(case, 1.0)


def test_a_report_is_a_path_and_a_link(ran, tmp_path):
    run = drivetwin.open(copied(ran[1], tmp_path))
    report = run.report()
    assert Path(report).read_text().startswith("<!DOCTYPE html>")
    assert "report.html</a>" in in_a_notebook(report)
    assert "of 2 passed" in repr(report)
    page = in_a_notebook(run.report(embed=True))
    assert page.startswith("<iframe srcdoc=")
    assert "allow-same-origin" not in page


def in_a_notebook(shown: object) -> str:
    """What a notebook shows for it."""
    return HTMLFormatter()(shown) or ""


def copied(run: Path, folder: Path) -> Path:
    """The run again, for tests that change it."""
    return Path(shutil.copytree(run, folder / "copy"))


@pytest.mark.parametrize("file", ["outcomes.json", "kpi.parquet"])
def test_a_damaged_run_is_an_error_in_one_line(ran, tmp_path, file):
    folder = copied(ran[1], tmp_path)
    path = next(folder.rglob(file))
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    with pytest.raises(drivetwin.InfrastructureError) as caught:
        drivetwin.open(folder).kpis(path.parents[1].name)
    assert len(str(caught.value).splitlines()) == 1
    assert file in str(caught.value)
    with pytest.raises(drivetwin.InfrastructureError):
        _ = drivetwin.Run(folder).fingerprint


def test_what_was_changed_after_signing_is_not_shown(ran, tmp_path):
    folder = copied(ran[1], tmp_path)
    path = folder / "outcomes.json"
    text = path.read_text()
    changed = text.replace('"time_up"', '"pass"')
    assert changed != text
    path.write_text(changed)
    for read in (lambda run: run.cases(), lambda run: run.report(), lambda run: run.fingerprint):
        with pytest.raises(drivetwin.TwinError, match="not what was signed"):
            read(drivetwin.open(folder))


def test_a_mistake_is_a_short_traceback(marked, tmp_path):
    done = marked.run(task(tmp_path, 'import drivetwin\ndrivetwin.run("aeb-dmo")'), folder=tmp_path)
    lines = done.stderr.splitlines()
    assert lines[-1].startswith("twin.base.errors.UsageError: aeb-dmo: no such campaign; did you")
    ours = [line for line in lines if line.startswith("  File") and "/drivetwin/" in line]
    assert 1 <= len(ours) <= 4
    assert not [line for line in lines if "/conductor/" in line]
    assert not (tmp_path / "runs").exists()


def test_nothing_was_simulated(marked, tmp_path):
    code = f"""
        import drivetwin
        run = drivetwin.run("{written(tmp_path, SMALL)}", workers=1, progress=False)
        print(run.summary())
        for read in (run.cases, run.report, lambda: run.kpis("0"), lambda: run.frame("0", 1.0)):
            try:
                read()
            except drivetwin.UsageError as error:
                print(f"{{type(error).__name__}}: {{error}}")
    """
    done = marked.run(task(tmp_path, code), folder=tmp_path)
    assert done.returncode == 0, done.stderr
    said = done.stdout.splitlines()
    assert said[0] == "3 of 3 passed (3 pass)"
    assert len(said) == 5
    assert "nothing was simulated" in said[1]
    assert "nothing was simulated" in said[2]
    assert "2 of 3" not in done.stderr, "no progress was asked for"


def test_stopped_and_resumed(marked, tmp_path):
    code = f"""
        import drivetwin
        from drivetwin import RunProgress

        started = drivetwin.start("{written(tmp_path, LONG)}", workers=1, slots=1)
        for event in started.events():
            if isinstance(event, RunProgress) and event.ended:
                started.stop()
                break
        try:
            started.wait(progress=False)
        except drivetwin.UnfinishedError as error:
            print(error)
        assert not started.running
        first = drivetwin.open("runs/long").outcomes()
        ended = sum(bool(case.outcome) for case in first.cases.values())
        assert 0 < ended < len(first.cases), ended
        run = drivetwin.run("{tmp_path}/long.yaml", workers=1, slots=64, progress=False)
        print(run.summary())
        print(run.fingerprint.sha256)
        assert all(a.attempt == run.outcomes().cases[n].attempt
                   for n, a in first.cases.items() if a.outcome)
    """
    done = marked.run(task(tmp_path, code), folder=tmp_path)
    assert done.returncode == 0, done.stderr
    said = done.stdout.splitlines()
    assert said[0] == "runs/long: stopped; the same call goes on"
    assert said[1] == f"{LONG_CASES} of {LONG_CASES} passed ({LONG_CASES} pass)"
    printed = marked.run("conductor", "fingerprint", "runs/long", folder=tmp_path)
    assert printed.stdout.strip() == said[2]


def test_an_interrupt_ends_workers_and_leaves_a_run_that_goes_on(marked, tmp_path):
    code = f"""
        import signal, threading, drivetwin
        from drivetwin import RunProgress

        started = drivetwin.start("{written(tmp_path, LONG)}", workers=1, slots=1)

        def interrupt():
            for event in started.events():
                if isinstance(event, RunProgress) and event.ended:
                    return signal.raise_signal(signal.SIGINT)

        threading.Thread(target=interrupt).start()
        try:
            started.wait()
        except KeyboardInterrupt:
            print("interrupted", started.running)
    """
    done = marked.run(task(tmp_path, code), folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "interrupted False"
    assert "interrupted; the same call goes on" in done.stderr
    assert not complete(tmp_path / "runs" / "long")


def test_one_run_at_a_time_in_a_process_and_in_a_folder(marked, tmp_path):
    other = written(tmp_path, {**SMALL, "campaign": "other"})
    code = f"""
        import subprocess, sys, drivetwin, psutil
        from drivetwin import RunProgress

        started = drivetwin.start("{written(tmp_path, LONG)}", workers=1, slots=1)
        next(e for e in started.events() if isinstance(e, RunProgress) and e.ended)
        workers = [p for p in psutil.Process().children() if "worker" in p.cmdline()]
        for worker in workers:
            worker.suspend()  # so that it does not end before the others have tried
        try:
            drivetwin.run("{other}")
        except drivetwin.UsageError as error:
            print(error)
        code = "import drivetwin\\ntry: drivetwin.run('{tmp_path}/long.yaml')\\n" \\
               "except drivetwin.TwinError as error: print(error)"
        print(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout)
        for worker in workers:
            worker.resume()
        started.stop()
        try:
            started.wait()
        except drivetwin.UnfinishedError:
            print(drivetwin.run("{other}", workers=1, progress=False).summary())
    """
    done = marked.run(task(tmp_path, code), folder=tmp_path)
    assert done.returncode == 0, done.stderr
    first, second, *_, last = done.stdout.splitlines()
    assert first == f"{other}: this process runs {tmp_path}/long.yaml; wait for it, or stop it"
    assert "another" in second
    assert last == "3 of 3 passed (3 pass)"


def test_a_process_that_ends_without_waiting_leaves_nothing(marked, tmp_path):
    code = f"""
        import drivetwin
        from drivetwin import RunProgress

        started = drivetwin.start("{written(tmp_path, LONG)}", workers=1, slots=1)
        next(e for e in started.events() if isinstance(e, RunProgress) and e.ended)
    """
    done = marked.run(task(tmp_path, code), folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert not complete(tmp_path / "runs" / "long")
    words = (str(tmp_path / "long.yaml"), "--workers", "1", "--slots", "64")
    again = marked.run("conductor", "run", *words, folder=tmp_path)
    assert again.returncode == 0, again.stderr
    assert "going on" in again.stderr


def test_a_run_in_a_store(marked, tmp_path):
    store = f"file://{tmp_path}/store"
    words = ("--workers", "1", "--store", store)
    done = marked.run("conductor", "run", str(written(tmp_path, SMALL)), *words, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    run = drivetwin.open(store, out=tmp_path / "fetched")
    assert run.folder == tmp_path / "fetched"
    assert run.outcomes() == drivetwin.open(tmp_path / "runs" / "small").outcomes()
    with pytest.raises(drivetwin.UsageError, match="no run of a campaign other; there: small"):
        drivetwin.open(f"{store}/runs/other", out=tmp_path / "none")


def test_beside_an_event_loop(marked, tmp_path):
    code = f"""
        import asyncio, drivetwin
        from drivetwin import RunProgress

        async def main():
            run = await drivetwin.arun("{written(tmp_path, SMALL)}", workers=1)
            print(run.summary())
            started = drivetwin.start("{tmp_path}/small.yaml", out="again", workers=1)
            seen = [e async for e in started.aevents() if isinstance(e, RunProgress)]
            assert (await started).fingerprint == run.fingerprint
            print(seen[-1].ended, "of", seen[-1].cases)
            task = asyncio.ensure_future(drivetwin.arun("{written(tmp_path, LONG)}", workers=1))
            await asyncio.sleep(0)
            task.cancel()
            try:
                await task
            except asyncio.CancelledError:
                print("cancelled")
            print(drivetwin.start("{tmp_path}/small.yaml", workers=1).wait().exit_code)

        asyncio.run(main())
    """
    done = marked.run(task(tmp_path, code), folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == ["3 of 3 passed (3 pass)", "3 of 3", "cancelled", "0"]
    assert "all 3 cases have ended already" in done.stderr


def test_an_extra_that_is_missing_is_named(marked, tmp_path):
    code = """
        import sys
        sys.modules["scipy"] = sys.modules["fsspec"] = None
        import drivetwin
        try:
            drivetwin.search("aeb-search", workers=1)
        except drivetwin.UsageError as error:
            print(error)
        try:
            drivetwin.open("s3://bucket/night")
        except drivetwin.TwinError as error:
            print(error)
    """
    done = marked.run(task(tmp_path, code), folder=tmp_path)
    assert done.returncode == 0, done.stderr
    search, store = done.stdout.splitlines()
    assert "drivetwin[search]" in search
    assert "drivetwin[store]" in store
