"""Commands for keys: ``conductor keygen`` for a fabric, ``invite`` and ``revoke`` for a member."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from schemas.words import counted
from twin.base.errors import UsageError, storage_error
from twin.fabric.connection_options import KeyOption
from twin.fabric.keys.roles import IN_WORDS, INVITED, Role

if TYPE_CHECKING:
    from twin.fabric.discovery import ConductorFile
    from twin.fabric.keys.key_file import MemberKey

MODE = 0o600


def add_key_commands(app: typer.Typer) -> None:
    """Add the commands to ``app``."""
    app.command()(keygen)
    app.command()(invite)
    app.command()(revoke)


def own_key(key: Path | None, *, insecure: bool) -> MemberKey | None:
    """The key that a conductor is given, if any.

    Raises:
        UsageError: it is not fit, or there is to be none.
    """
    from twin.fabric.keys.key_file import load_key

    if key is None:
        return None
    if insecure:
        raise UsageError(
            f"--insecure and --key {key} (or TWIN_KEY): a key makes it TLS; leave one of them away"
        )
    return load_key(key, Role.conductor)


def keygen(
    folder: Annotated[
        Path | None,
        typer.Argument(help="Folder of keys to write, for its owner only; --signing: a file."),
    ] = None,
    state: Annotated[
        Path | None,
        typer.Option(help="Or: a conductor's state folder, whose keys lie in your own folder."),
    ] = None,
    days: Annotated[int, typer.Option(min=1, max=3650, help="How long they are valid [days].")] = (
        365
    ),
    force: Annotated[
        bool, typer.Option("--force", help="Replace keys; whoever has an old one is shut out.")
    ] = False,
    signing: Annotated[
        bool,
        typer.Option(
            "--signing",
            help="A key to sign runs and certificates with instead, and print its public key; "
            "default: signing.key in your own folder.",
        ),
    ] = False,
) -> None:
    """Make the keys of a new fabric: of its authority, and one for each role.

    A conductor makes its own by itself; those of --state FOLDER --force take their place.
    """
    if signing:
        if state is not None or force:
            raise UsageError("--signing takes neither --state nor --force; give the file alone")
        from conductor.trust.signing import new_signer

        print(new_signer(folder).public)
        return
    from twin.fabric.keys.authority import make_keys, refuse_keys_in
    from twin.fabric.keys.own_keys import fabric_name, make_way, note

    if folder is not None and state is None:
        print(make_keys(folder, days=days, replace=force))
        return
    if state is None or folder is not None:
        raise UsageError("give either a folder of keys to write, or --state FOLDER of a conductor")
    refuse_keys_in(state)
    made = make_keys(make_way(fabric_name(state)), days=days, replace=force)
    note(made, state)
    print(made)


def invite(
    role: Annotated[
        Role, typer.Option(help="What the holder may do: viewer, worker, admin or submitter.")
    ],
    state: Annotated[
        Path | None,
        typer.Option(help="State folder of the conductor; your own folder has its keys."),
    ] = None,
    key: KeyOption = None,
    days: Annotated[
        int, typer.Option(min=1, max=3650, help="How long the key is valid [days].")
    ] = 30,
    connect: Annotated[
        str,
        typer.Option(help="Endpoint to name, e.g. of a relay; default: the conductor's own."),
    ] = "",
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="Write a file, mode 0600; default: a line.")
    ] = None,
) -> None:
    """Make a key for one more member, as a file or as a line to paste into one.

    It names the conductor: `viewer live --key FILE` needs nothing else. Treat it as a password.
    """
    from twin.base.files import write_atomic
    from twin.fabric.endpoint import check_protected
    from twin.fabric.keys.authority import days_left, load_authority
    from twin.fabric.keys.key_file import as_line

    if role not in INVITED:
        allowed = ", ".join(INVITED)
        raise UsageError(
            f"--role {role}: allowed: {allowed}; a conductor has its own key, and a stack gets one "
            "from its rig"
        )
    folder, conductor = _where(state, key)
    authority = load_authority(folder)
    if days > (most := days_left(authority)):
        raise UsageError(
            f"--days {days}: this fabric ends in {most} days, allowed: 1 to {most}; "
            "`conductor keygen --force` makes a new one"
        )
    if connect:
        check_protected(connect, keyed=True)
    endpoint = connect or (conductor.endpoint if conductor else "")
    data = authority.issue(role, days, endpoint, conductor.namespace if conductor else "")
    description = f"a key of role {role} for {days} days, which {IN_WORDS[role]}"
    if out is None:
        print(as_line(data).decode())
        print(
            f"conductor: {description}; paste the line into a file of mode 0600 and give that as "
            "--key",
            file=sys.stderr,
        )
        return
    try:
        write_atomic(out, data, mode=MODE)
    except OSError as error:
        raise storage_error(error, str(out)) from None
    print(out)
    print(f"conductor: {description}", file=sys.stderr)


def revoke(
    which: Annotated[
        str,
        typer.Argument(
            metavar="KEY",
            help="Key file, or a serial number as audit.jsonl names it.",
        ),
    ],
    state: Annotated[
        Path | None, typer.Option(help="State folder of the conductor, which holds keys/.")
    ] = None,
    key: KeyOption = None,
) -> None:
    """Withdraw a key: a conductor that serves with the same keys cuts its sessions at once, and
    refuses it from now on. A relay on another host reads the list beside its own key."""
    from conductor.serve.audit import await_cut
    from twin.fabric.keys.revoked import check_of_fabric, read_revoked, revoke, serial_of

    folder, conductor = _where(state, key)
    if not folder.is_dir():
        raise UsageError(f"{folder}: not a folder of keys; give --state FOLDER or --key FOLDER")
    serial = serial_of(which)
    check_of_fabric(which, folder)
    if serial in read_revoked(folder):
        print(f"key {serial:x} was withdrawn already")
        return
    watched = await_cut(state, serial) if state is not None and conductor is not None else None
    revoke(folder, serial)
    cut = watched() if watched is not None else None
    if cut is None:
        print(f"withdrew key {serial:x}; a conductor that serves now cuts its sessions")
    else:
        print(f"withdrew key {serial:x}; {counted(cut, 'session')} of it cut")


def _where(state: Path | None, key: Path | None) -> tuple[Path, ConductorFile | None]:
    """The folder of keys, and the conductor that is known there, if any."""
    from twin.fabric.discovery import find_conductor, keys_of
    from twin.fabric.keys.authority import refuse_keys_in
    from twin.fabric.keys.own_keys import fabric_folder, fabric_name

    if state is None:
        if key is None:
            raise UsageError("no fabric given; use --state FOLDER or --key FOLDER")
        return key, None
    try:
        conductor = find_conductor(state)
    except UsageError:
        conductor = None  # it may come later
    if key is not None:
        return key, conductor
    if conductor is not None and conductor.insecure:
        raise UsageError(f"{state}: its conductor was told --insecure and takes no keys")
    refuse_keys_in(state)
    return keys_of(conductor, state) if conductor else fabric_folder(fabric_name(state)), conductor
