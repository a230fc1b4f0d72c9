"""How long `conductor verify` takes over a large run of small cases.

``python tests/verify_scale.py --cases 100000 --folder build`` writes a run of three files per case
with its journal, signs it, and verifies it; exits with 1 beyond a minute.
"""

from __future__ import annotations

import argparse
import resource
import sys
import tempfile
import time
from pathlib import Path

import msgspec

from conductor.bench.client import full_result
from conductor.bench.scale import large_campaign
from conductor.core.state import Config
from conductor.journal.store import Journal
from conductor.records.outcomes import encode_campaign, read_outcomes
from conductor.serve.engine import ConductorEngine, IncomingRequest
from conductor.serve.folders import Folders
from conductor.trust.sign_run import sign_run
from conductor.trust.signing import trusted_keys
from conductor.trust.verify import verify_run
from schemas import SCHEMA_VERSION as V
from schemas.wire.codec import decode, encode
from schemas.wire.control import Hello, Next, Reply, Submit
from twin.fabric.session import new_secret

WALL_S_MAX = 60.0
K = 64


def write_run(folder: Path, cases: int) -> None:
    """A finished campaign of ``cases`` cases, a multiple of 32, as a conductor leaves it."""
    journal = Journal(folder)
    engine = ConductorEngine(journal, Config(folder=str(folder)), 0)

    def ask(request: object) -> Reply:
        (answer,) = engine.turn([IncomingRequest(encode(request), 0)]).replies
        assert answer is not None
        reply = decode(answer, Reply)
        assert not reply.error, reply.error
        return reply

    ask(Submit(v=V, campaign=msgspec.to_builtins(large_campaign(cases)), out=str(folder)))
    session = new_secret()
    about = {"host": "h", "pid": 1, "device_class": "cpu", "software": "s", "slots": K}
    ask(Hello(v=V, worker="w", session=session, **about))
    results, seq = [], 0
    while True:
        seq += 1
        reply = ask(Next(v=V, worker="w", seq=seq, k=K, results=results, session=session))
        results = [full_result(lease) for lease in reply.leases]
        if not results:
            break
        for result in results:
            attempt = folder / result.attempt_dir
            attempt.mkdir(parents=True)
            for name in ("kpi.parquet", "log.txt", "judge.json"):
                (attempt / name).write_bytes(f"{name} {result.case}\n".encode() * 20)
    (campaign,) = engine.state.campaigns.values()
    (folder / "outcomes.json").write_bytes(encode_campaign(campaign))
    files = Folders(folder)
    files.open_campaign(campaign)
    files.flush()
    engine.close()
    journal.close()


def main() -> int:
    """Write, sign, verify, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=100_000)
    parser.add_argument("--folder", type=Path, default=Path("build"))
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    cases = -(-given.cases // 32) * 32
    with tempfile.TemporaryDirectory(dir=given.folder) as name:
        folder = Path(name).absolute()
        write_run(folder, cases)
        begin_s = time.perf_counter()
        sign_run(folder, read_outcomes(folder), "")
        signed_s = time.perf_counter() - begin_s
        found = verify_run(folder, trusted_keys())
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    print(
        f"{cases} cases, {found.files} files: signed in {signed_s:.1f} s, verified in "
        f"{found.wall_s:.1f} s, {peak_mb:.0f} MB at most; differences: {found.differences[:3]}"
    )
    return 1 if found.differences or found.wall_s > WALL_S_MAX else 0


if __name__ == "__main__":
    sys.exit(main())
