"""Whatever is changed in a certificate is refused, in one line that says what."""

from __future__ import annotations

import hashlib
import json

import msgspec
import pytest
from certificates import campaign, decoded, made, signer
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from conductor.certify.form import (
    CAMPAIGN_BYTES_MAX,
    FILE_BYTES_MAX,
    Certificate,
    encode_certificate,
    read_certificate,
)
from conductor.certify.merkle import root_of
from conductor.certify.rows import leaves_of
from twin.base.errors import EXIT_INFRASTRUCTURE, EXIT_USAGE, TwinError, UsageError

TRUE = made()
DATA = encode_certificate(TRUE)


def refused(data: bytes, *keys) -> TwinError:
    with pytest.raises(TwinError) as caught:
        decoded(data, *keys)
    assert len(str(caught.value).splitlines()) == 1
    return caught.value


def of(certificate: Certificate, **changed) -> bytes:
    """A certificate whose parts were changed, and whose signature was not."""
    return encode_certificate(msgspec.structs.replace(certificate, **changed))


def headed(**changed) -> bytes:
    """A certificate whose head was changed, and whose signature was not."""
    head = json.loads(TRUE.signed) | changed
    return of(TRUE, signed=json.dumps(head, separators=(",", ":")).encode())


def test_what_was_written_is_read():
    assert decoded(DATA) == TRUE
    assert encode_certificate(decoded(DATA)) == DATA


ROWS = TRUE.rows
CHANGED_ROW = msgspec.structs.replace(ROWS[2], outcome="verdict/pass")


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ([ROWS[1], ROWS[0], *ROWS[2:]], "or they were reordered"),
        (ROWS[:-1], "has 7 rows, signed were 8"),
        ([*ROWS, ROWS[-1]], "has 9 rows, signed were 8"),
        ([*ROWS[:-1], ROWS[0]], "one was changed"),
        ([*ROWS[:2], CHANGED_ROW, *ROWS[3:]], "one was changed"),
        ([msgspec.structs.replace(ROWS[0], kpi="0" * 64), *ROWS[1:]], "one was changed"),
        ([msgspec.structs.replace(ROWS[0], device=-1), *ROWS[1:]], "one was changed"),
        ([msgspec.structs.replace(ROWS[0], device=7), *ROWS[1:]], "names a device class"),
        ([], "has 0 rows"),
    ],
)
def test_rows_that_were_not_signed(rows, words):
    error = refused(of(TRUE, rows=rows))
    assert words in str(error)
    assert error.exit_code == EXIT_INFRASTRUCTURE


def test_rows_reordered_under_their_own_root_by_another_key():
    forged = made(rows=ROWS[::-1], key=signer(2))
    error = refused(encode_certificate(forged))
    assert f"signed by key {signer(2).public}, which is not trusted here" in str(error)


def test_another_key_put_over_the_same_signature():
    assert "its signature does not fit" in str(refused(of(TRUE, key=signer(2).public), signer(2)))


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"root": "0" * 64}, "signature does not fit"),
        ({"software": "0" * 64}, "signature does not fit"),
        ({"digest": "0" * 64}, "signature does not fit"),
        ({"protected": False}, "signature does not fit"),
        ({"made": "2020-01-01T00:00:00Z"}, "signature does not fit"),
    ],
)
def test_a_changed_head(changed, words):
    assert words in str(refused(headed(**changed)))


def test_a_swapped_campaign_and_a_swapped_lock():
    other = made(campaign(8, seed=3))
    assert "its campaign is not the one that was signed" in str(
        refused(of(TRUE, campaign=other.campaign))
    )
    assert "its lock is not the one that was signed" in str(refused(of(TRUE, lock=b"[]")))


def test_the_same_case_in_two_rows_of_a_signed_table():
    twice = made(rows=[ROWS[0], *ROWS])
    assert "a case stands in two rows" in str(refused(encode_certificate(twice)))


@pytest.mark.parametrize("cut", [0, 1, 100, len(DATA) // 2, len(DATA) - 3])
def test_a_file_that_was_cut_off(cut):
    error = refused(DATA[:cut])
    assert "no certificate, or damaged or cut off" in str(error)
    assert error.exit_code == EXIT_USAGE


@pytest.mark.parametrize("more", [b"\n", b" ", b"{}", b"\0", DATA])
def test_bytes_behind_the_end(more):
    words = str(refused(DATA + more))
    assert "bytes were added" in words or "cut off" in words


@pytest.mark.parametrize(
    "data",
    [
        DATA.replace(b'","rows":', b'", "rows":'),
        DATA.replace(b'"rows":[[', b'"rows":[ ['),
        DATA[:-1],
        DATA.replace(b'{"format"', b'{"format":"drivetwin certificate 1","format"'),
        b"\xef\xbb\xbf" + DATA,
    ],
)
def test_the_same_content_written_otherwise(data):
    assert data != DATA
    refused(data)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"null",
        b"[" * 100_000,
        b'{"format":"drivetwin certificate 1","head":' + b"[" * 100_000,
        DATA.replace(b"certificate 1", b"certificate 2", 1),
        DATA.replace(b'"key":"', b'"key":"zz', 1),
        DATA.replace(b'"rows":[[', b'"rows":[[' + b"9" * 5000 + b",", 1),
        DATA.replace(b',"lock"', b',"more":1,"lock"', 1),
        bytes(1000),
    ],
)
def test_what_is_no_certificate(data):
    refused(data)


def test_deep_nesting_and_wild_numbers_in_a_signed_campaign():
    for bad in (b"[" * 5000 + b"]" * 5000, b'{"seed":' + b"9" * 5000 + b"}", b'{"seed":1e999}'):
        certificate = made()
        head = json.loads(certificate.signed)
        assert head["campaign"]
        words = str(refused(of(certificate, campaign=bad)))
        assert "its campaign is not" in words or "no certificate" in words


def test_parts_have_bounds():
    big = b'"' + b"x" * CAMPAIGN_BYTES_MAX + b'"'
    assert f"at most {CAMPAIGN_BYTES_MAX} are read" in str(refused(of(TRUE, campaign=big)))


def test_a_large_file_is_not_read(tmp_path):
    path = tmp_path / "c.cert"
    with path.open("wb") as file:
        file.truncate(FILE_BYTES_MAX + 1)
    with pytest.raises(UsageError, match="at most"):
        read_certificate(path, [signer().public])


@pytest.mark.parametrize("name", ["missing", ".", "/dev/zero"])
def test_only_regular_files_are_read(tmp_path, name):
    with pytest.raises(UsageError):
        read_certificate(tmp_path / name, [signer().public])


@settings(max_examples=300, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.integers(0, len(DATA) - 1), st.integers(1, 255))
def test_any_changed_byte_is_found(at, mask):
    changed = bytearray(DATA)
    changed[at] ^= mask
    refused(bytes(changed))


def test_somebody_else_can_check_it_from_the_page_alone():
    """docs/audit.md, "The file": with a JSON parser, SHA-256 and Ed25519, and nothing of ours."""
    file = json.loads(DATA)
    assert DATA.endswith(b"}\n")
    begin = DATA.index(b'"head":') + len(b'"head":')
    head = DATA[begin : DATA.index(b',"key":')]
    key = Ed25519PublicKey.from_public_bytes(bytes.fromhex(file["key"]))
    key.verify(bytes.fromhex(file["signature"]), b"drivetwin certificate 1\0" + head)
    assert json.loads(head) == file["head"]
    for name in ("campaign", "lock"):
        text = json.dumps(file[name], separators=(",", ":"), ensure_ascii=False).encode()
        assert hashlib.sha256(text).hexdigest() == file["head"][name]
    level = []
    for case, outcome, kpi, device in file["rows"]:
        device_class = file["head"]["made_in"]["device_classes"][device]
        parts = (case.encode(), outcome.encode(), bytes.fromhex(kpi), device_class.encode())
        leaf = b"".join(len(part).to_bytes(8, "little") + part for part in parts)
        level.append(hashlib.sha256(b"\0" + leaf).digest())
    while len(level) > 1:  # eight rows: every level is even
        pairs = zip(level[::2], level[1::2], strict=True)
        level = [hashlib.sha256(b"\1" + left + right).digest() for left, right in pairs]
    assert level[0].hex() == file["head"]["root"]


def test_the_root_is_over_case_outcome_kpi_and_device():
    classes = TRUE.head.made_in.device_classes
    assert root_of(leaves_of(TRUE.rows, classes)).hex() == TRUE.head.root
    assert root_of(leaves_of(TRUE.rows, ["cuda:NVIDIA H200"])).hex() != TRUE.head.root
