"""Attacks on a finished run: somebody changes what lies there, and asks for a report."""

from __future__ import annotations

import hashlib
import json

from attacks import Found, attack, refused_if
from foreign_campaigns import campaign
from theatre import Theatre


@attack(14, "edits `outcomes.json` of a finished run", "who writes a run folder", "files")
def edited_outcomes(theatre: Theatre) -> Found:
    """Collisions become passes, unsigned sums are computed again; then report and verify."""
    path = campaign(theatre.folder, "edited", {"stack": "devkit.aeb:AebStack"})
    out = theatre.folder / "run"
    done = theatre.marked.run(*("conductor", "run", str(path), "--workers", "1", "--out", str(out)))
    assert done.returncode in (0, 1), done.stderr
    file = out / "outcomes.json"
    outcomes = json.loads(file.read_text())
    before = hashlib.sha256(file.read_bytes()).hexdigest()
    for case in outcomes["cases"].values():
        case["verdict"] = "pass" if case["verdict"] != "pass" else "collision"
    file.write_text(json.dumps(outcomes))
    after = hashlib.sha256(file.read_bytes()).hexdigest()
    manifest = out / "manifest.json"
    if manifest.exists():
        manifest.write_text(manifest.read_text().replace(before, after))
    report = theatre.marked.run("conductor", "report", str(out))
    verify = theatre.marked.run("conductor", "verify", str(out))
    codes = f"report exits with {report.returncode}, verify with {verify.returncode}"
    return refused_if(
        (report.returncode, verify.returncode) == (3, 3), f"signed manifest: {codes}", codes
    )
