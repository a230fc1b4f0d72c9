"""``conductor.json``: how workers and viewers find a conductor on a shared file system."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import msgspec

from schemas.files.json_text import JsonError, decode_json
from schemas.files.regular_file import RUN_FILE_BYTES_MAX, read_regular
from twin.base.errors import UnreachableError, UsageError
from twin.base.own_folder import VARIABLE
from twin.fabric.endpoint import NAMESPACE, is_tls
from twin.fabric.keys.key_file import MemberKey, UnfitKeyError, load_key
from twin.fabric.keys.own_keys import fabric_folder
from twin.fabric.keys.roles import Role

FILE_NAME = "conductor.json"
"""Name of the file in the state folder and in each campaign folder."""

OUTCOMES_NAME = "outcomes.json"
"""Name of the file in a campaign folder that says how its cases ended."""

POLL_S = 0.2
"""How often a conductor that is awaited is looked for [s]."""


class RunEndedError(UsageError):
    """Every case of a run has ended, and no conductor serves it any more."""


class _Complete(msgspec.Struct, frozen=True):
    """The part of ``outcomes.json`` that is read here."""

    complete: bool = False


class ConductorFile(msgspec.Struct, frozen=True):
    """Content of ``conductor.json``."""

    endpoint: str
    pid: int
    host: str
    epoch: int
    namespace: str
    version: str
    key: str = ""
    """Path of the folder of keys, as the conductor sees it; empty: there is none."""
    insecure: bool = False
    """Whether the conductor speaks plain TCP, which has to be typed on every side."""
    fabric: str = ""
    """Under which name its user's own folder has the keys; empty: they lie elsewhere."""


@dataclass(frozen=True, slots=True)
class Target:
    """Endpoint and namespace to connect to, and the key to use."""

    endpoint: str
    namespace: str
    key: MemberKey | None


def await_conductor(folder: Path, wait_s: float, role: Role, key: Path | None = None) -> Target:
    """Target as of :func:`find_target`, but a conductor that just starts may take ``wait_s`` [s].

    A file of a conductor that was killed is left behind, so the endpoint must answer.

    Raises:
        UsageError: there is no file, or it is damaged; or the key does not fit.
        UnreachableError: nobody answers at its endpoint.
    """
    from twin.fabric.handshake import greet  # late: it loads OpenSSL for Python

    until_s = time.monotonic() + wait_s
    while True:
        try:
            target = find_target(folder, role, key)
            greet(target.endpoint, target.key)
            return target
        except UnfitKeyError:
            raise
        except UnreachableError as error:
            if time.monotonic() >= until_s:
                raise UnreachableError(
                    f"{error}; start it again, or remove the stale {folder / FILE_NAME}"
                ) from None
        except UsageError:
            if time.monotonic() >= until_s:
                raise
        time.sleep(POLL_S)


def await_endpoint(target: Target, wait_s: float) -> None:
    """Return once somebody answers at ``target``, which may take ``wait_s`` [s].

    Raises:
        UsageError: who answers is not of the key's fabric.
        UnreachableError: nobody answers.
    """
    from twin.fabric.handshake import greet

    until_s = time.monotonic() + wait_s
    while True:
        try:
            return greet(target.endpoint, target.key)
        except UnreachableError:
            if time.monotonic() >= until_s:
                raise
        time.sleep(POLL_S)


def find_target(folder: Path, role: Role, key: Path | None = None) -> Target:
    """Target of the conductor of a state or campaign folder; with this user's key of ``role``,
    unless one is given.

    Raises:
        UsageError: there is no conductor, or no fit key.
    """
    conductor = find_conductor(folder)
    if key is None and is_tls(conductor.endpoint):
        key = keys_of(conductor, folder)
    return Target(
        conductor.endpoint, conductor.namespace, load_key(key, role) if key is not None else None
    )


def keys_of(found: ConductorFile, folder: Path) -> Path:
    """The folder of keys of a conductor that was found in ``folder``.

    What runs as this user may write there, and must not say which keys are to be believed: it names
    a fabric of the user's own folder, or keys that somebody gave the conductor elsewhere.

    Raises:
        UnfitKeyError: they lie in ``folder``, or the user's own folder is not that user's alone.
        UsageError: this user has none of this fabric.
    """
    if not found.fabric:
        path = Path(found.key)
        if not found.key or path.resolve().is_relative_to(folder.resolve()):
            raise UnfitKeyError(
                f"{folder / FILE_NAME}: names no keys outside of its folder, where they are not "
                "believed; give them with --key, or start the conductor again"
            )
        return path
    kept = fabric_folder(found.fabric)
    if not kept.exists():
        raise UsageError(
            f"{kept}: you have no keys of this conductor; they lie in the own folder of the user "
            f"who started it: set {VARIABLE} as it was there, or ask for a key "
            "(`conductor invite`) and give it with --key"
        )
    return kept


def choose_target(
    connect: str, folder: Path | None, namespace: str, key: Path | None, role: Role
) -> Target:
    """What the command line says: an endpoint, the folder of a conductor, or a key that knows.

    Args:
        connect: endpoint; empty: see the others.
        folder: state or campaign folder.
        namespace: prefix of every key at ``connect``, unless an invitation says which.
        key: key file, or a folder of keys.
        role: what the command does needs a key of this role.

    Raises:
        UsageError: none of them; or no conductor there, or no fit key.
    """
    if folder is not None and not connect:
        return find_target(folder, role, key)
    member_key = load_key(key, role) if key is not None else None
    endpoint = connect or (member_key.endpoint if member_key else "")
    if endpoint:
        return Target(endpoint, agreed_namespace(namespace, member_key), member_key)
    raise UsageError(
        "no conductor given; use --connect tls/HOST:PORT or --state FOLDER "
        "(`conductor serve` prints both), or the --key of an invitation, which names it"
    )


def agreed_namespace(given: str, key: MemberKey | None) -> str:
    """The namespace to speak in: that of an invitation, or else the one given.

    Raises:
        UsageError: they contradict each other.
    """
    if key is None or not key.namespace or key.namespace == given:
        return given
    if given != NAMESPACE:
        raise UsageError(
            f"--namespace {given}: {key.path} is an invitation to namespace {key.namespace}; leave "
            "--namespace away, or ask for a key of the other conductor"
        )
    return key.namespace


def find_conductor(folder: Path) -> ConductorFile:
    """Read ``conductor.json`` of a state or campaign folder.

    Raises:
        RunEndedError: it is the folder of a run that has ended.
        UsageError: there is none, or it is damaged.
    """
    path = folder / FILE_NAME
    try:
        return decode_json(read_regular(path, RUN_FILE_BYTES_MAX), ConductorFile)
    except FileNotFoundError:
        if not folder.is_dir():
            raise UsageError(
                f"{folder}: no such folder; give that of a conductor or of a campaign that runs "
                "(`viewer live --wait SECONDS` waits for one that is about to)"
            ) from None
        if _has_ended(folder):
            raise RunEndedError(
                f"{folder}: this run has ended; `conductor report {folder}` tells what came of it, "
                f"`viewer replay {folder}` shows what was recorded"
            ) from None
        raise UsageError(
            f"{path}: no conductor serves this folder; start one with "
            f"`conductor serve --state {folder}`"
        ) from None
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}") from None
    except JsonError as error:
        raise UsageError(f"{path}: damaged: {error}") from None


def refuse_ended(folder: Path) -> None:
    """Refuse to wait for a conductor in a folder that is not there, or whose run has ended.

    Raises:
        UsageError: one of the two; it says where to look instead.
    """
    if folder.is_dir() and not ((folder / FILE_NAME).exists() or _has_ended(folder)):
        return  # one may start, or come back
    find_conductor(folder)


def _has_ended(folder: Path) -> bool:
    """Whether all cases of a campaign folder have outcomes."""
    try:
        return decode_json(
            read_regular(folder / OUTCOMES_NAME, RUN_FILE_BYTES_MAX), _Complete
        ).complete
    except (OSError, JsonError):
        return False
