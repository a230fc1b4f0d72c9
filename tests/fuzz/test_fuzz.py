"""Every decoder on every seed, and on what Hypothesis makes of them for a few seconds."""

from __future__ import annotations

import random

import pytest
from fuzz_table import TARGETS
from fuzz_target import SEEDS, Target, attempt, seed_files
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

TRIES_MS = 150
"""About how long Hypothesis tries a target [ms]."""
TRIES_MAX = 50

INTERESTING = (
    *(b"\0", b"\xff" * 4, b"\x7f\xff\xff\xff", b"\x80\0\0\0", b"\xdf\xff\xff\xff\xff", b"\xc1"),
    *(b"-1", b"1e400", b".nan", b"9" * 400, b"{", b"[", b"]", b"*a", b"&a "),
    *(b"../", b"\n", b"\x1b[2J", b"\xe2\x80\xa8"),
)
"""What parsers stumble over."""


@pytest.mark.parametrize("name", TARGETS)
def test_every_seed_is_a_value_or_a_line(name: str) -> None:
    target = TARGETS[name]
    files = seed_files(name, target)
    accepted = [attempt(target, path.read_bytes()) for path in files]
    assert any(accepted), f"no seed of {name} is accepted: fuzzing begins with nothing"


def test_a_case_file_is_given_however_often_it_is_asked_for() -> None:
    """Of a target that answers "busy" fuzzing learns nothing."""
    (seed,) = (SEEDS / "wire-case-file").glob("log*")
    target = TARGETS["wire-case-file"]
    answers = [target.run(seed.read_bytes()) for _ in range(5_000)]
    assert {getattr(answer, "data", None) for answer in answers} == {b"log"}


def test_every_folder_of_seeds_has_its_target() -> None:
    assert {path.name for path in SEEDS.iterdir()} <= set(TARGETS)


@pytest.mark.parametrize("name", TARGETS)
def test_mutations_are_values_or_lines(name: str) -> None:
    target = TARGETS[name]
    seeds = [path.read_bytes() for path in seed_files(name, target)]

    @settings(
        max_examples=max(5, min(TRIES_MAX, TRIES_MS // target.cost)),
        deadline=None,
        derandomize=True,
        database=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(st.sampled_from(seeds), st.randoms(use_true_random=False), st.binary(max_size=64))
    def tried(seed: bytes, dice: random.Random, noise: bytes) -> None:
        attempt(target, mutated(seed, dice, noise))

    tried()


def mutated(seed: bytes, dice: random.Random, noise: bytes) -> bytes:
    """Up to four changes of ``seed``: bits, bytes, pieces left out, doubled, swapped, cut off."""
    data = bytearray(seed)
    for _ in range(dice.randrange(4) + 1):
        at = dice.randrange(len(data) + 1)
        size = dice.choice((1, 2, 4, 16, 256))
        match dice.randrange(8):
            case 0 if at < len(data):
                data[at] ^= 1 << dice.randrange(8)
            case 1 if at < len(data):
                data[at] = dice.randrange(256)
            case 2:
                del data[at : at + size]
            case 3:
                data[at:at] = data[at : at + size] * dice.choice((1, 2, 50))
            case 4:
                data[at:at] = noise
            case 5:
                data[at : at + dice.choice((0, size))] = dice.choice(INTERESTING)
            case 6:
                other = dice.randrange(len(data) + 1)
                data[at : at + size] = data[other : other + size]
            case _:
                del data[at:]
    return bytes(data)


def test_a_target_that_breaks_its_word_is_found() -> None:
    """The harness itself: another exception, several lines, no words."""

    def raising(error: Exception) -> Target:
        def run(_data: bytes) -> None:
            raise error

        return Target(run, (ValueError,))

    assert not attempt(raising(ValueError("no")), b"")
    for broken in (KeyError("k"), ValueError("two\nlines"), ValueError(""), ValueError("x" * 9999)):
        with pytest.raises((KeyError, AssertionError)):
            attempt(raising(broken), b"")
