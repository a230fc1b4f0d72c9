"""``conductor audit``: does a certificate tell the truth? A sample of its cases is run again."""

from __future__ import annotations

import json
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, get_args

import msgspec
import typer

from conductor.commands.options import Device, MemoryGb, Slots, Workers
from schemas.escape import escape
from schemas.words import counted
from twin.base.cli import Output, OutputOption
from twin.base.errors import UsageError

if TYPE_CHECKING:
    from conductor.certify.audit import AuditOptions, RunCases
    from conductor.certify.comparing import Audited
    from conductor.certify.form import Certificate
    from conductor.certify.timestamp import Timestamp

SHOWN_MAX = 20
"""Cases that are named for people."""


CertificateFile = Annotated[
    Path | None,
    typer.Argument(metavar="FILE", help="Certificate that `conductor certify` wrote."),
]
RunAtHand = Annotated[
    Path | None,
    typer.Option(help="Folder of the run, if at hand: says which KPI values differ."),
]
CasesToDraw = Annotated[
    int,
    typer.Option(min=0, max=100_000, help="Cases to draw and run again; 0: look at it only."),
]
DrawSeed = Annotated[
    str,
    typer.Option(
        help="Public text that decides the draw, best one that nobody knew when the "
        "certificate was made; default: a random one, which is told."
    ),
]
AuditFolder = Annotated[
    Path | None,
    typer.Option(help="Folder to run in; default runs/audit-CAMPAIGN-TABLE. Again: resume."),
]
FilesNeeded = Annotated[
    Path | None,
    typer.Option(help="Folder with the files that its campaign needs; their digests decide."),
]
PublicKeys = Annotated[
    list[str] | None,
    typer.Option(
        help="Who may have signed it: 64 hexadecimal digits or a file of them; repeatable. "
        "Default: your own key, and those in your list of trusted keys."
    ),
]
RunStack = Annotated[
    bool,
    typer.Option("--run-stack", help="Run the stack that it names, which is none of ours."),
]
NoSandbox = Annotated[
    bool,
    typer.Option("--allow-unprotected", help="Its stack may run here without a sandbox."),
]
TsaRoot = Annotated[
    Path | None,
    typer.Option(help="Root certificates (PEM) of the authority that set its timestamp."),
]
ProofFile = Annotated[
    Path | None,
    typer.Option(help="Check this proof of a single case instead; nothing is run."),
]
PrintLock = Annotated[
    bool,
    typer.Option("--lock", help="Print what was installed, for `pip install -r`; run nothing."),
]


def audit_command(
    file: CertificateFile = None,
    run: RunAtHand = None,
    cases: CasesToDraw = 300,
    seed: DrawSeed = "",
    out: AuditFolder = None,
    files: FilesNeeded = None,
    public_key: PublicKeys = None,
    run_stack: RunStack = False,
    allow_unprotected: NoSandbox = False,
    tsa_root: TsaRoot = None,
    proof: ProofFile = None,
    lock: PrintLock = False,
    workers: Workers = None,
    slots: Slots = None,
    device: Device = "cpu",
    memory_gb: MemoryGb = None,
    output: OutputOption = Output.human,
) -> None:
    """Check a certificate, and run cases of it again that a public seed draws: their outcomes and
    KPI bytes must be those of its table. Says what follows for the whole table.

    Exit code 1: a case came to something else; 2: no certificate, or your word is missing; 3: it is
    not what was signed, or cannot be decided here; 75: unfinished, the same command goes on.
    """
    from conductor.trust.signing import parse_key, trusted_keys

    trusted = frozenset(map(parse_key, public_key)) if public_key else trusted_keys()
    if proof is not None:
        if file is not None:
            raise UsageError("--proof is checked alone; leave the certificate away")
        _check_proof(proof, trusted)
        return
    if file is None:
        raise UsageError("give a certificate, or --proof FILE")
    from conductor.certify.audit import AuditOptions
    from conductor.certify.consent import Consent
    from conductor.certify.form import read_certificate
    from conductor.certify.lock import decode_lock, requirements
    from conductor.certify.timestamp import timestamp_of

    certificate = read_certificate(file, trusted)
    if lock:
        print(requirements(decode_lock(certificate.lock, str(file))), end="")
        return
    _tell(certificate, timestamp_of(certificate, tsa_root, str(file)))
    consent = Consent(run_stack, allow_unprotected, files)
    options = AuditOptions(cases, seed, out, run, consent)
    running = _on_this_machine(workers, slots, device, memory_gb)
    _audit(certificate, str(file), options, running, as_json=output is Output.json)


def _audit(
    certificate: Certificate,
    shown: str,
    options: AuditOptions,
    run_cases: RunCases,
    *,
    as_json: bool,
) -> None:
    from conductor.certify.audit import audit, inspect

    if not options.cases:
        print(inspect(certificate, shown))
        return
    audited = audit(certificate, shown, options, run_cases)
    if isinstance(audited, int):
        raise typer.Exit(audited)
    _print_json(audited, certificate) if as_json else _print(audited)
    raise typer.Exit(audited.exit_code)


def _on_this_machine(
    workers: str | None, slots: int | None, device: str, memory_gb: float | None
) -> RunCases:
    """Runs a plan as `conductor run` does, without a report."""
    from conductor.run.gpu_sharing import side_by_side
    from conductor.run.gpu_turns import turns
    from conductor.run.places import parse_workers, where
    from schemas.plan import Plan
    from twin.base.process import keep_to_itself
    from twin.fabric.endpoint import demand_keys

    demand_keys()  # as every command that serves: other users of this host reach its loopback
    asked, place = where(parse_workers(workers), device)

    def run_cases(plan: Plan, folder: Path) -> int:
        from conductor.run.command import RunOptions, local_workers, run_campaign

        options = RunOptions(
            out=folder, workers=asked, slots=slots, device=place, memory_gb=memory_gb, report=False
        )
        with ExitStack() as at_end:
            computed = at_end.enter_context(side_by_side(place))
            at_end.enter_context(turns(place))
            keep_to_itself()
            local = local_workers(plan, options)
            at_end.callback(local.stop)
            return run_campaign(plan, options, local, computed)

    return run_cases


def _tell(certificate: Certificate, timestamp: Timestamp | None) -> None:
    """What a certificate says of itself, on standard error."""
    head = certificate.head
    by = f", by {head.by}" if head.by else ""
    outcomes = ", ".join(f"{count} {name}" for name, count in sorted(head.outcomes.items()))
    devices = ", ".join(head.made_in.device_classes) or "no device"
    said = [
        f"{head.name}: {counted(head.count, 'case')} ({outcomes}), {head.stack}",
        f"signed by key {certificate.key}{by}, made {head.made} as they say",
        f"ran on {devices}; software {head.software[:12]}",
        "in a sandbox: " + ", ".join(head.protection)
        if head.protected
        else "UNPROTECTED: its stack could have written its verdicts; running it again tells",
    ]
    if timestamp is not None:
        said.append(timestamp.words)
    for line in said:
        print(f"conductor: {escape(line)}", file=sys.stderr)


def _check_proof(path: Path, trusted: frozenset[str]) -> None:
    from conductor.certify.proof import read_proof

    proof = read_proof(path, trusted)
    head, row = proof.head, proof.row
    print(
        f"{escape(row.case, 200)}: {escape(row.outcome, 200)}, KPIs {row.kpi or 'none'}; one of "
        f"{counted(head.count, 'case')} of {escape(head.name, 200)}, signed by key {proof.key}"
    )


def _print_json(audited: Audited, certificate: Certificate) -> None:
    from conductor.certify.comparing import Kind

    counts = {kind.replace(" ", "_"): audited.count(kind) for kind in get_args(Kind)}
    said = {"key": certificate.key, "protected": certificate.head.protected}
    shown = {**said, **msgspec.to_builtins(audited), **counts, "bound": audited.bound}
    print(json.dumps({**shown, "holds": not audited.exit_code}))


def _print(audited: Audited) -> None:
    from conductor.certify.comparing import lines

    for line in lines(audited, SHOWN_MAX):
        print(escape(line))
    print(f"drawn by seed {escape(audited.seed)} of table {audited.root}")
