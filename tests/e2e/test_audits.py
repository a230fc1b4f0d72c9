"""Certificates of real runs, and audits that run their cases again with real processes."""

from __future__ import annotations

import json
import shutil
import signal
import sys
from pathlib import Path

import msgspec
import numpy
import pytest
from certificates import campaign, made, signer
from changed_campaigns import changed
from foreign_campaigns import CLIENT
from processes import outcomes
from waiting import wait_for

from conductor.certify.draw import draw
from conductor.certify.form import Certificate, encode_certificate, read_certificate
from conductor.certify.making import sealed
from conductor.certify.rows import Row
from conductor.trust.signing import own_signer, trusted_keys
from schemas.files.software import DECODERS, RUNTIMES, digest_of

OPTIONS = ("--workers", "1", "--output", "json")


@pytest.fixture
def certificate(marked, quiet, tmp_path):
    """The file of a certificate of a finished run."""
    path = tmp_path / "chaos.cert"
    done = marked.run("conductor", "certify", str(quiet["folder"]), "-o", str(path))
    assert done.returncode == 0, done.stderr
    return path


def audited(marked, path: Path, *options: str, code: int = 0):
    """What an audit says as JSON."""
    done = marked.run("conductor", "audit", str(path), *OPTIONS, *options)
    assert done.returncode == code, done.stderr
    return json.loads(done.stdout)


def refused(marked, *words: str, code: int) -> str:
    """The line by which a command refuses, of exit code ``code``."""
    done = marked.run("conductor", *words)
    assert done.returncode == code, done.stderr
    line = done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr
    return line


def forged(path: Path, row: Row, place: int, into: Path) -> Path:
    """A certificate with another row, signed by the same key: its owner lies."""
    true = read_certificate(path, trusted_keys())
    rows = [*true.rows[:place], row, *true.rows[place + 1 :]]
    lie: Certificate = sealed(true.head, rows, true.campaign, true.lock, own_signer())
    into.write_bytes(encode_certificate(lie))
    return into


def test_a_true_table_holds_and_is_certified_by_the_runs_own_values(
    marked, quiet, certificate, tmp_path
):
    table = read_certificate(certificate, trusted_keys())
    ran = outcomes(quiet["folder"])
    assert {row.case: row.kpi for row in table.rows} == {n: c["kpi_sha256"] for n, c in ran.items()}
    assert table.head.fingerprint == quiet["fingerprint"]
    assert table.head.protected
    out = tmp_path / "audit"
    found = audited(marked, certificate, "--cases", "4", "--seed", "lotto", "--out", str(out))
    assert found["same"] == 4
    names = [row.case for row in table.rows]
    assert [each["case"] for each in found["findings"]] == draw(table.head.root, "lotto", names, 4)
    assert "with 95 % confidence fewer than 8 of 16 rows are false" in found["bound"]
    # From the certificate alone, and cases were run: four, in a folder of their own.
    assert set(outcomes(out)) == set(draw(table.head.root, "lotto", names, 4))
    again = audited(marked, certificate, "--cases", "4", "--out", str(out))
    assert again == found
    line = refused(marked, "audit", str(certificate), "--cases", "5", "--out", str(out), code=2)
    assert "holds an audit of 4 cases by seed 'lotto'" in line


def test_a_lie_is_found_and_both_values_are_said(marked, quiet, certificate, tmp_path):
    table = read_certificate(certificate, trusted_keys())
    place = next(n for n, row in enumerate(table.rows) if row.outcome == "verdict/collision")
    row = table.rows[place]
    lie = msgspec.structs.replace(row, outcome="verdict/pass", kpi="0" * 64)
    path = forged(certificate, lie, place, tmp_path / "lie.cert")
    root = read_certificate(path, trusted_keys()).head.root
    names = [each.case for each in table.rows]
    seed = next(s for s in map(str, range(99)) if row.case in draw(root, s, names, 2))
    out = ("--cases", "2", "--seed", seed, "--out", str(tmp_path / "a"))
    found = audited(marked, path, *out, code=1)
    (wrong,) = [each for each in found["findings"] if each["kind"] == "false"]
    assert wrong["case"] == row.case
    assert wrong["words"].startswith("verdict/pass against verdict/collision, KPIs 000000000000")
    assert row.kpi[:12] in wrong["words"]
    assert (found["bound"], found["holds"]) == ("", False)
    run = ("--run", str(quiet["folder"]))
    line = refused(marked, "audit", str(path), *run, *out, code=3)
    assert f"is not the run of {path}: case {row.case} is another" in line


def test_a_table_of_a_machine_with_other_runtimes_holds_and_one_of_other_files_is_named(
    marked, certificate, tmp_path
):
    true = read_certificate(certificate, trusted_keys())
    assert true.files is not None
    libraries = {n: v for n, v in true.head.libraries.items() if n not in (*RUNTIMES, *DECODERS)}
    libraries |= {"onnxruntime-gpu": "1.31.1", "nvidia-cublas": "13.0"}
    other = resealed(true, true.files, libraries, tmp_path / "gpu.cert")
    assert other.head.software != true.head.software
    out = ("--cases", "2", "--seed", "lotto", "--out", str(tmp_path / "a"))
    assert audited(marked, tmp_path / "gpu.cert", *out)["same"] == 2
    resealed(true, true.files | {"twin/cli.py": "0" * 64}, libraries, tmp_path / "old.cert")
    line = refused(marked, "audit", str(tmp_path / "old.cert"), *out, code=3)
    assert "; twin/cli.py has another content here; install that version" in line


def resealed(
    true: Certificate, files: dict[str, str], libraries: dict[str, str], into: Path
) -> Certificate:
    """A certificate of the same rows, made where other files and libraries are installed."""
    software = digest_of(files, libraries)
    head = msgspec.structs.replace(true.head, software=software, libraries=libraries)
    other = sealed(head, true.rows, true.campaign, true.lock, own_signer(), files)
    into.write_bytes(encode_certificate(other))
    return other


def test_an_interrupted_audit_goes_on(marked, certificate, tmp_path):
    out = tmp_path / "audit"
    words = ("conductor", "audit", str(certificate), "--out", str(out), *OPTIONS)
    child = marked.start(*words)
    wait_for(lambda: list(out.glob("cases/*/attempt-*")), "an attempt")
    child.send_signal(signal.SIGTERM)
    child.communicate()
    assert child.returncode == 75
    found = audited(marked, certificate, "--out", str(out))
    assert (found["same"], len(found["findings"])) == (16, 16)
    assert found["bound"] == "no row of 16 is false: all were run again"


def test_runs_that_are_not_certified(marked, quiet, tmp_path):
    out = ("-o", str(tmp_path / "c.cert"))
    copy = Path(shutil.copytree(quiet["folder"], tmp_path / "copy"))
    (copy / "outcomes.json").write_text(
        (copy / "outcomes.json").read_text().replace('"time_up"', '"pass"')
    )
    assert "is not as it was signed" in refused(marked, "certify", str(copy), *out, code=3)
    for name in ("manifest.json", "manifest.derived.json"):
        (copy / name).unlink()
    assert "is not signed" in refused(marked, "certify", str(copy), *out, code=3)
    data = json.loads((quiet["folder"] / "outcomes.json").read_text())
    data["complete"] = False
    next(iter(data["cases"].values()))["outcome"] = ""
    (copy / "outcomes.json").write_text(json.dumps(data))
    assert "1 of 16 cases has not ended" in refused(marked, "certify", str(copy), *out, code=75)
    parts = json.loads((copy / "software.json").read_text())
    parts["libraries"]["numpy"] = "1.0"
    (copy / "software.json").write_text(json.dumps(parts))
    data |= {"complete": True, "software": digest_of(parts["files"], parts["libraries"])}
    (copy / "outcomes.json").write_text(json.dumps(data))
    line = refused(marked, "certify", str(copy), *out, code=2)
    assert f"; numpy 1.0: here {numpy.__version__}; certify it with" in line
    assert "no such folder" in refused(marked, "certify", str(tmp_path / "x"), *out, code=2)
    assert not (tmp_path / "c.cert").exists()


def inline(data):
    data["matrix"] = {"model": ["yolov3"], "weather": ["clear"], "time_of_day": ["13:00"]}
    data["autonomy"]["placement"] = "inline"


def test_a_run_without_a_sandbox_is_certified_and_audited_only_if_told(marked, tmp_path):
    folder, path = tmp_path / "run", tmp_path / "c.cert"
    campaign = changed(tmp_path, "chaos-16", inline)
    done = marked.run("conductor", "run", campaign, "--out", str(folder), "--workers", "1")
    assert done.returncode == 1, done.stderr
    words = ("certify", str(folder), "-o", str(path))
    line = refused(marked, *words, code=2)
    assert "its stack had no sandbox (unprotected: autonomy.placement inline" in line
    assert marked.run("conductor", *words, "--allow-unprotected").returncode == 0
    table = read_certificate(path, trusted_keys())
    assert not table.head.protected
    audit = ("audit", str(path), "--out", str(tmp_path / "audit"), *OPTIONS)
    assert "give --allow-unprotected" in refused(marked, *audit, code=2)
    done = marked.run("conductor", *audit, "--allow-unprotected")
    assert done.returncode == 0, done.stderr
    assert "UNPROTECTED: its stack could have written its verdicts" in done.stderr


def foreign(data):
    data["matrix"] = {"weather": ["clear", "heavy_rain"]}
    data["autonomy"] = {"command": [sys.executable, str(CLIENT)]}


def test_a_stack_of_ones_own_is_run_in_a_sandbox_and_only_if_told(marked, tmp_path):
    folder, path, out = tmp_path / "run", tmp_path / "c.cert", tmp_path / "audit"
    campaign = changed(tmp_path, "chaos-16", foreign)
    done = marked.run("conductor", "run", campaign, "--out", str(folder), "--workers", "1")
    assert done.returncode in (0, 1), done.stderr
    assert marked.run("conductor", "certify", str(folder), "-o", str(path)).returncode == 0
    audit = ("audit", str(path), "--out", str(out), *OPTIONS)
    line = refused(marked, *audit, code=2)
    assert f"would run the command `{sys.executable} {CLIENT}` on this machine" in line
    assert not out.exists()
    found = audited(marked, path, "--out", str(out), "--run-stack")
    assert found["same"] == 2
    protection = json.loads((out / "outcomes.json").read_text())["protection"]
    assert protection == json.loads((folder / "outcomes.json").read_text())["protection"]
    assert not any(each.startswith("unprotected") for each in protection)


def test_a_stack_that_rolls_dice_is_found_with_the_values_that_differ(marked, tmp_path):
    stack, folder, path = tmp_path / "dice.py", tmp_path / "run", tmp_path / "c.cert"
    brake = "float(braking[slot])"
    assert brake in CLIENT.read_text()
    diced = f'{brake} * (1 - __import__("os").urandom(1)[0] / 2560)'
    stack.write_text(CLIENT.read_text().replace(brake, diced))

    def dice(data):
        foreign(data)
        data["autonomy"]["command"][1] = str(stack)

    campaign = changed(tmp_path, "chaos-16", dice)
    done = marked.run("conductor", "run", campaign, "--out", str(folder), "--workers", "1")
    assert done.returncode in (0, 1), done.stderr
    assert marked.run("conductor", "certify", str(folder), "-o", str(path)).returncode == 0
    out = ("--out", str(tmp_path / "audit"), "--run", str(folder), "--run-stack")
    found = audited(marked, path, *out, code=1)
    assert (found["false"], found["bound"]) == (2, "")
    words = found["findings"][0]["words"]
    assert "first brake at tick" in words
    assert "against" in words
    stack.write_text(stack.read_text() + "# changed\n")
    again = ("--out", str(tmp_path / "other"), "--run-stack")
    line = refused(marked, "audit", str(path), *again, *OPTIONS, code=3)
    assert "the stack here is another one:" in line


def test_noop_starts_no_stack_whatever_the_certificate_names(marked, tmp_path):
    ran, path = tmp_path / "ran", tmp_path / "c.cert"
    command = {"command": ["/bin/sh", "-c", f"touch {ran}"]}
    path.write_bytes(encode_certificate(made(campaign(2, autonomy=command))))
    options = ("--public-key", signer().public, "--out", str(tmp_path / "audit"))
    found = audited(marked, path, *options, code=1)  # its KPIs are inventions
    assert found["false"] == 2
    assert not ran.exists()


def test_a_key_of_ones_own_signs_and_must_be_known(marked, quiet, tmp_path):
    key, path = tmp_path / "anna.key", tmp_path / "c.cert"
    made = marked.run("conductor", "keygen", str(key), "--signing")
    assert made.returncode == 0, made.stderr
    assert key.stat().st_mode & 0o777 == 0o600
    assert "is there already" in refused(marked, "keygen", str(key), "--signing", code=2)
    certify = ("certify", str(quiet["folder"]), "-o", str(path), "--key", str(key))
    assert marked.run("conductor", *certify, "--by", "Anna").returncode == 0
    line = refused(marked, "audit", str(path), "--cases", "0", code=3)
    assert f"signed by key {made.stdout.strip()}, which is not trusted here" in line
    public = ("--public-key", made.stdout.strip())
    done = marked.run("conductor", "audit", str(path), "--cases", "0", *public)
    assert done.returncode == 0, done.stderr
    assert "by Anna" in done.stderr
