"""Whether the networks of a campaign can be loaded, before any of its cases is leased.

Loading them is the business of ``devkit``, which is asked as any user would ask it: by a process of
its own, once for all networks. A network that takes its process down is one that cannot be loaded;
one that was loaded before by the same software on such a device is not loaded again.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

import msgspec

from conductor.run.known_good import remember, remembered
from schemas.digest import digest
from schemas.files.assets import file_digest
from schemas.kinds.perception import perception_kind, perception_kinds
from schemas.plan import Plan
from schemas.sections.perception import Perception, file_fields, what_is_loaded
from schemas.validation import Mistake
from twin.base.errors import InfrastructureError, UsageError
from twin.base.process import how_it_ended
from twin.base.software import device_class, software_digest

TIMEOUT_S = 100.0
"""Longest time to load all networks [s]; less than `hpc` waits for the check of a campaign."""

FILE = "good-networks.json"
"""File of the digests of good networks, see :mod:`conductor.run.known_good`."""


def check_models(plan: Plan, shown: str, device: str = "cpu") -> None:
    """Load the networks that cases of ``plan`` use; see :func:`models_checked`."""
    with models_checked(plan, shown, device):
        pass


@contextmanager
def models_checked(plan: Plan, shown: str, device: str = "cpu") -> Iterator[None]:
    """Load the networks that cases of ``plan`` use, on this machine, while the body
    of the ``with`` does something else; it is known at its end. Those that are known to be good
    (:func:`identities`) are not loaded.

    Args:
        plan: with absolute paths, see :func:`conductor.run.source.load`.
        shown: name of the campaign for messages.
        device: where workers on this machine compute, ``cpu`` or ``cuda:N``.

    Raises:
        UsageError: one line per network that cannot be loaded, naming its file.
        InfrastructureError: the check itself did not work.
    """
    cases = plan.cases
    used = {
        case.variation.model: case.variation.perception
        for case in cases
        if perception_kind(case.variation.perception).loaded
    }
    if not used:
        yield
        return
    # The same network with another threshold is loaded once.
    first: dict[bytes, str] = {}
    for name, variant in used.items():
        first.setdefault(msgspec.json.encode(what_is_loaded(variant)), name)
    camera, files = cases[0].rig.camera, plan.campaign.files
    size_px = (camera.width, camera.height)
    known = identities({name: used[name] for name in first.values()}, files, device, size_px)
    good = set(remembered(FILE))
    asked = {name: used[name] for name in first.values() if known.get(name) not in good}
    if not asked:
        yield
        return
    with _ask(asked, size_px, device) as child:
        try:
            yield
            answer = _answer(child, asked)
        finally:
            child.kill()
    loaded = [name for name in asked if not answer[name].error]
    # What was loaded may be other files than those that were read before.
    good_now = [known[n] for n in loaded if n in known and unchanged(asked[n], files)]
    remember(FILE, good_now)
    mistakes = [
        Mistake(f"autonomy.perception.{name}", answer[name].error)
        for name in asked
        if name not in loaded
    ]
    if mistakes:
        raise UsageError("\n".join(mistake.line(shown) for mistake in mistakes))


def _ask(
    variants: dict[str, Perception], size_px: tuple[int, int], device: str
) -> subprocess.Popen[bytes]:
    command = [
        *(sys.executable, "-m", "devkit", "check-models", "--device", device),
        *("--width", str(size_px[0]), "--height", str(size_px[1])),
    ]
    pipe = subprocess.PIPE
    child = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe)
    assert child.stdin is not None
    with suppress(BrokenPipeError):  # then it has ended, and says why
        child.stdin.write(msgspec.json.encode(variants))
        child.stdin.close()
    child.stdin = None
    return child


class Tried(msgspec.Struct, frozen=True):
    """Answer of `devkit check-models` about one variant."""

    error: str
    """Mistake in one line; empty: it can be loaded."""


def _answer(child: subprocess.Popen[bytes], names: Collection[str]) -> dict[str, Tried]:
    shown = ", ".join(names)
    try:
        output, errors = child.communicate(timeout=TIMEOUT_S)
    except subprocess.TimeoutExpired:
        raise InfrastructureError(
            f"networks {shown}: not loaded within {TIMEOUT_S:g} s; is the file system busy?"
        ) from None
    try:
        if child.returncode == 0:
            # What libraries may print stands before the answer.
            tried = msgspec.json.decode(output.splitlines()[-1], type=dict[str, Tried])
            if tried.keys() >= set(names):
                return tried
    except (msgspec.DecodeError, IndexError):
        pass
    words = errors.decode(errors="replace").strip().splitlines() or ["it said nothing"]
    raise InfrastructureError(
        f"networks {shown}: the process that loads them ended without an answer"
        f" ({how_it_ended(child.returncode)}): {words[-1][:300]}"
    )


def identities(
    variants: Mapping[str, Perception],
    files: Mapping[str, str],
    device: str,
    size_px: tuple[int, int],
) -> dict[str, str]:
    """Name -> digest of what decides whether the network can be loaded; without those of which
    that is not known.

    Args:
        variants: paths in them are absolute.
        files: path -> SHA-256 of the files that they name.
        device: where the networks are loaded, ``cpu`` or ``cuda:N``.
        size_px: width and height of the pictures [px].
    """
    try:
        place = (software_digest(), device_class(device), *map(str, size_px))
    except UsageError:
        return {}  # no such device: whoever loads them says so
    return {
        name: digest(part.encode() for part in (*place, *_parts(variant, files)))
        for name, variant in variants.items()
        if all(path in files for path in file_fields(variant).values())
    }


def _parts(variant: Perception, files: Mapping[str, str]) -> list[str]:
    """Where a file lies does not matter, but what its name ends with does."""
    keys = what_is_loaded(variant)
    for key, path in file_fields(variant).items():
        keys[key] = [Path(path).suffix, files[path]]
    plugin = perception_kinds().brought.get(perception_kind(variant).name, ())
    return [*plugin, msgspec.json.encode(keys).decode()]


def unchanged(variant: Perception, files: Mapping[str, str]) -> bool:
    """Whether the files of ``variant`` are still those of ``files``."""
    try:
        return all(file_digest(Path(p)) == files[p] for p in file_fields(variant).values())
    except OSError:
        return False
