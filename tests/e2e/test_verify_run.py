"""A finished run is signed: what is changed in it afterwards is found, by verify and reports."""

import json
import os
import shutil
import signal
import sqlite3
from contextlib import closing
from pathlib import Path

import msgspec
import pytest
from byte_changes import missed
from changed_campaigns import changed
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from foreign_distributions import install
from processes import wait_for

from conductor.core.facts import Committed, Durable
from conductor.journal.chain import Chain
from conductor.trust.manifest import listed, read_manifest, signed, write_manifest
from conductor.trust.signing import Signer, trusted_keys
from conductor.trust.verify import verify_run
from schemas.wire.codec import decode, encode


@pytest.fixture
def copy(quiet, tmp_path):
    """A finished run that a test may change."""
    return Path(shutil.copytree(quiet["folder"], tmp_path / "run"))


def verified(marked, folder, *options):
    """Exit code and what it said as JSON."""
    done = marked.run("conductor", "verify", str(folder), "--output", "json", *options)
    assert done.returncode in (0, 3), done.stderr
    found = json.loads(done.stdout)
    assert found["fits"] is (done.returncode == 0)
    return done.returncode, found


def differences(folder):
    """What verify says, in this process."""
    return verify_run(folder, trusted_keys()).differences


def test_a_finished_run_fits_and_its_verdicts_follow_from_its_rows(marked, quiet):
    code, found = verified(marked, quiet["folder"], "--deep")
    assert (code, found["differences"]) == (0, [])
    assert found["attempts"] == 16
    assert found["attempts_per_s"] > 0
    assert found["fingerprint"] == quiet["fingerprint"]
    judged = json.loads((quiet["folder"] / "judgement.json").read_text())
    assert (judged["attempts"], judged["agree"]) == (16, 16)
    assert "signed by key" in (quiet["folder"] / "report.html").read_text()


def test_changed_bytes_are_found_wherever_they_are(copy):
    assert missed(copy, 60, seed=24) == []


@pytest.mark.parametrize("command", ["report", "fingerprint", "compare", "export"])
def test_reports_refuse_a_run_that_does_not_fit(marked, quiet, copy, command):
    path = copy / "outcomes.json"
    path.write_text(path.read_text().replace('"verdict":"collision"', '"verdict":"pass"'))
    more = {"compare": [str(quiet["folder"])], "export": ["--out", str(copy / "new")]}
    done = marked.run("conductor", command, str(copy), *more.get(command, []))
    assert done.returncode == 3
    assert done.stderr.count("\n") == 1
    assert "outcomes.json is not what was signed; restore it" in done.stderr


def one_case(data):
    data["matrix"] = {"model": ["yolov3"], "weather": ["clear"], "time_of_day": ["13:00"]}


def test_a_run_that_is_opened_again_must_fit_and_is_signed_again(marked, tmp_path):
    folder, campaign = tmp_path / "run", changed(tmp_path, "chaos-16", one_case)

    def run():
        return marked.run("conductor", "run", campaign, "--out", str(folder), "--workers", "1")

    done = run()
    assert done.returncode == 1, done.stderr
    before = read_manifest(folder)
    done = run()
    assert done.returncode == 1, done.stderr
    after = read_manifest(folder)
    assert after.journal.count > before.journal.count
    assert after.fingerprint == before.fingerprint
    assert not (folder / "manifest.before.json").exists()
    assert differences(folder) == []
    # An attempt that was changed in between is not signed.
    log = next(folder.glob("cases/*/attempt-1/log.txt"))
    text = log.read_bytes()
    log.write_bytes(text + b"x")
    done = run()
    assert done.returncode == 3
    assert "is not what was signed" in done.stderr
    assert any("log.txt" in line for line in differences(folder))
    log.write_bytes(text)
    path = folder / "outcomes.json"
    path.write_bytes(path.read_bytes() + b" ")
    done = run()
    assert done.returncode == 3
    assert "outcomes.json is not what was signed" in done.stderr
    assert (folder / "manifest.json").exists()


def test_a_copy_of_a_finished_run_goes_on_by_itself(marked, tmp_path):
    folder, campaign = tmp_path / "run", changed(tmp_path, "chaos-16", one_case)

    def run(out):
        done = marked.run("conductor", "run", campaign, "--out", str(out), "--workers", "1")
        assert done.returncode == 1, done.stderr

    run(folder)
    copy = Path(shutil.copytree(folder, tmp_path / "elsewhere" / "copy"))
    assert differences(copy) == []
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    run(copy)
    after = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    assert after == before
    assert differences(folder) == []
    assert differences(copy) == []
    assert read_manifest(copy).journal.count > read_manifest(folder).journal.count


def test_a_refused_command_takes_away_no_signature(marked, tmp_path):
    folder, campaign = tmp_path / "run", changed(tmp_path, "chaos-16", one_case)
    command = ("conductor", "run", campaign, "--out", str(folder), "--workers", "1")
    assert marked.run(*command).returncode in (0, 1)
    manifest = read_manifest(folder)
    refused = marked.run(*command, "--seed", "99")
    assert refused.returncode == 2, refused.stderr
    assert read_manifest(folder).files.keys() == manifest.files.keys()
    assert differences(folder) == []


def test_a_report_that_is_made_again_fits(marked, copy):
    done = marked.run("conductor", "report", str(copy))
    assert done.returncode == 1, done.stderr
    assert (copy / "plots").is_dir()
    assert differences(copy) == []
    page = copy / "report.html"
    page.write_bytes(page.read_bytes() + b" ")
    (found,) = differences(copy)
    assert found.startswith("report.html:")
    page.unlink()  # who does not need it may remove it
    assert differences(copy) == []


def test_a_finished_run_that_is_run_again_with_another_library_fits(
    marked, copy, tmp_path, monkeypatch
):
    install(tmp_path / "site", "pillow", "99.0", "")
    paths = [str(tmp_path / "site"), os.environ.get("PYTHONPATH", "")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(paths))
    before = (copy / "report.html").read_bytes()
    done = marked.run("conductor", "run", str(copy / "campaign.yaml"), "--out", str(copy))
    assert done.returncode in (0, 1), done.stderr
    assert (copy / "report.html").read_bytes() != before, "it is made anew, and names the library"
    assert differences(copy) == []


def test_links_extra_and_missing_files_are_differences(copy):
    (copy / "cases/more").mkdir()
    (copy / "cases/more/kpi.parquet").write_bytes(b"")
    log = next(copy.glob("cases/*/attempt-1/log.txt"))
    kept = copy.parent / "log.txt"
    log.rename(kept)
    log.symlink_to(kept)
    (copy / "campaign.yaml").unlink()
    os.mkfifo(copy / "conductor.db-wal")
    found = "\n".join(differences(copy))
    assert f"{log.relative_to(copy)}: a symbolic link" in found
    assert "cases/more/kpi.parquet: is not in the manifest" in found
    assert "campaign.yaml: is missing" in found
    assert "conductor.db-wal: no plain file" in found


def test_a_run_without_a_manifest_is_told_to_be_unsigned(marked, copy):
    (copy / "manifest.json").unlink()
    code, found = verified(marked, copy)
    assert code == 3
    assert "is not signed: there is no manifest.json" in found["differences"][0]
    done = marked.run("conductor", "report", str(copy), "--output", "json")
    assert json.loads(done.stdout)["signature"] == "not signed"


def forged(folder):
    """Every verdict becomes `pass`, and every hash that needs no key is computed anew."""
    with closing(sqlite3.connect(folder / "conductor.db")) as connection:
        assert not connection.execute("SELECT count(*) FROM snapshot").fetchone()[0]
        chain, rows = Chain(), list(connection.execute("SELECT id, unix_s, fact FROM facts"))
        for number, unix_s, data in rows:
            fact = decode(data, Durable, size_max=1 << 30)
            if isinstance(fact, Committed):
                better = msgspec.structs.replace(fact.result, verdict="pass", reasons=["fine"])
                data = encode(msgspec.structs.replace(fact, result=better))
            chain, _ = chain.facts([data], unix_s)
            connection.execute(
                "UPDATE facts SET fact = ?, chain = ? WHERE id = ?", (data, chain.head, number)
            )
        old = connection.execute("SELECT value FROM meta WHERE name = 'chain'").fetchone()[0]
        old = msgspec.json.decode(old, type=Chain)
        chain = msgspec.structs.replace(chain, replies=old.replies)
        text = msgspec.json.encode(chain).decode()
        connection.execute("UPDATE meta SET value = ? WHERE name = 'chain'", (text,))
        connection.commit()
    path = folder / "outcomes.json"
    outcomes = json.loads(path.read_text())
    for case in outcomes["cases"].values():
        case |= {"verdict": "pass", "reasons": ["fine"], "passed": True}
    path.write_text(json.dumps(outcomes))
    manifest = read_manifest(folder)
    journal = msgspec.structs.replace(manifest.journal, head=chain.head.hex(), count=chain.count)
    files = listed(folder, lambda name: name in manifest.files)
    return msgspec.structs.replace(manifest, journal=journal, files=files)


def test_who_computes_every_hash_anew_is_found(marked, copy):
    write_manifest(copy, forged(copy))  # with the signature of before
    assert "the signature does not fit" in differences(copy)[0]
    done = marked.run("conductor", "fingerprint", str(copy))
    assert done.returncode == 3
    assert "the signature does not fit" in done.stderr


def test_who_signs_with_a_key_of_his_own_is_found(marked, copy):
    thief = Signer(Ed25519PrivateKey.generate())
    write_manifest(copy, signed(forged(copy), thief))
    code, found = verified(marked, copy)
    assert code == 3
    assert f"signed by key {thief.public}, which is not trusted" in found["differences"][0]
    done = marked.run("conductor", "report", str(copy))
    assert done.returncode == 3
    assert "which is not yours" in done.stderr
    # Even who trusts that key hears from the judge that the verdicts are not those of the rows.
    code, found = verified(marked, copy, "--deep", "--public-key", thief.public)
    assert code == 3
    assert any("the rows come to" in line for line in found["differences"])


def test_a_conductor_that_serves_on_signs_what_has_ended(marked, tmp_path):
    state, campaign = tmp_path / "state", changed(tmp_path, "chaos-16", one_case)
    folder = state / "chaos-16"
    server = marked.start("conductor", "serve", "--state", str(state))
    wait_for(lambda: (state / "conductor.json").exists(), "the conductor")
    done = marked.run("conductor", "submit", campaign, "--state", str(state))
    assert done.returncode == 0, done.stderr
    done = marked.run("twin", "worker", "--state", str(state), "--until-done")
    assert done.returncode == 0, done.stderr
    wait_for(lambda: (folder / "manifest.json").exists(), "its manifest")
    found = verify_run(folder, trusted_keys(), deep=True)
    assert found.differences == []
    assert found.attempts == 1
    assert "in use" in found.notes[0]
    server.send_signal(signal.SIGTERM)
    server.communicate()
    found = verify_run(folder, trusted_keys())
    assert (found.differences, found.notes) == ([], [])
    shutil.copytree(folder, tmp_path / "elsewhere")
    assert "is not here" in verify_run(tmp_path / "elsewhere", trusted_keys()).notes[0]
