"""``conductor certify``: a finished run as one signed file that others can audit."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from schemas.words import counted
from twin.base.errors import UsageError, storage_error
from twin.base.progress import bars

OutFile = Annotated[Path, typer.Option("--out", "-o", help="File to write; must not be there yet.")]


def certify_command(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="RUN",
            help="Campaign folder of a finished run; with --proof or --timestamp a certificate.",
        ),
    ],
    out: OutFile,
    key: Annotated[
        Path | None,
        typer.Option(
            help="Signing key, as `conductor keygen --signing` makes it; default: your own."
        ),
    ] = None,
    by: Annotated[str, typer.Option(help="Who certifies, e.g. 'Anna Berg, Example AG'.")] = "",
    lock: Annotated[
        Path | None,
        typer.Option(help="Report of `pip install --report`, for hashes of what is installed."),
    ] = None,
    allow_unprotected: Annotated[
        bool,
        typer.Option(
            "--allow-unprotected",
            help="Also certify a run whose stack had no sandbox; the certificate says so.",
        ),
    ] = False,
    proof: Annotated[
        str, typer.Option(metavar="CASE", help="Write the proof of one case of a certificate.")
    ] = "",
    timestamp: Annotated[
        Path | None,
        typer.Option(help="Write a certificate with this timestamp (RFC 3161, DER) attached."),
    ] = None,
) -> None:
    """Write a certificate of a finished run: what ran, its table of results, and the environment,
    signed. `conductor audit` runs a sample of it again, elsewhere and without the run.

    Exit code 75: cases have not ended; 3: the run is not as it was signed.
    """
    from conductor.certify.form import read_certificate
    from conductor.certify.proof import prove
    from conductor.certify.timestamp import with_timestamp
    from conductor.trust.signing import trusted_keys

    if out.exists():
        raise UsageError(f"--out {out}: is there already; give another name")
    if proof and timestamp is not None:
        raise UsageError("--proof and --timestamp: give one of them")
    if proof or timestamp is not None:
        certificate = read_certificate(source, trusted_keys())
        if timestamp is None:
            _write(out, prove(certificate, proof))
        else:
            _write(out, with_timestamp(certificate, timestamp))
        return
    _write(out, _certified(source, key, by, lock, unprotected=allow_unprotected))


def _certified(
    folder: Path, key: Path | None, by: str, lock: Path | None, *, unprotected: bool
) -> bytes:
    from conductor.certify.making import Asked, certify
    from conductor.certify.rows import TEXT_CHARS_MAX
    from conductor.trust.signing import load_signer, own_signer

    if not folder.is_dir():
        raise UsageError(f"{folder}: no such folder; give that of a run, e.g. runs/aeb-demo")
    if len(by) > TEXT_CHARS_MAX or not by.isprintable():
        raise UsageError(f"--by: one line of at most {TEXT_CHARS_MAX} characters")
    if key is not None and not key.exists():
        raise UsageError(f"--key {key}: no such file; `conductor keygen --signing {key}` makes one")
    signer = own_signer() if key is None else load_signer(key)
    with bars() as told:
        return certify(folder, Asked(signer, by, lock, unprotected), told)


def _write(out: Path, data: bytes) -> None:
    from twin.base.files import write_atomic

    try:
        write_atomic(out, data)
    except OSError as error:
        raise storage_error(error, str(out)) from None
    print(out)
    print(f"conductor: {counted(len(data), 'byte')}", file=sys.stderr)
