"""The proof of a single case."""

from __future__ import annotations

import json

import pytest
from certificates import campaign, made, signer

from conductor.certify.proof import FILE_BYTES_MAX, decode_proof, prove, read_proof
from twin.base.errors import TwinError, UsageError

CERTIFICATE = made(campaign(13))
CASE = CERTIFICATE.rows[5].case
DATA = prove(CERTIFICATE, CASE)
TRUSTED = {signer().public}


def refused(data: bytes, trusted=TRUSTED) -> str:
    with pytest.raises(TwinError) as caught:
        decode_proof(data, "p.json", trusted)
    assert len(str(caught.value).splitlines()) == 1
    return str(caught.value)


def changed(**values) -> bytes:
    return json.dumps(json.loads(DATA) | values).encode()


@pytest.mark.parametrize("row", CERTIFICATE.rows, ids=lambda row: row.case)
def test_every_case_is_proved(row):
    proof = decode_proof(prove(CERTIFICATE, row.case), "p.json", TRUSTED)
    assert (proof.row, proof.head) == (row, CERTIFICATE.head)
    assert proof.device_class == CERTIFICATE.device_class(row)


def test_a_case_that_is_not_there():
    with pytest.raises(UsageError, match="no case of 'table'; it has 13 cases") as caught:
        prove(CERTIFICATE, "x")
    assert str(caught.value).endswith(", ".join(row.case for row in CERTIFICATE.rows[:3]))
    with pytest.raises(UsageError, match=f"e.g. {CASE}"):
        prove(CERTIFICATE, CASE[:-1])


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"row": [CASE, "verdict/other", "0" * 64, 0]}, "not with this result"),
        ({"row": ["x", *json.loads(DATA)["row"][1:]]}, "is not in the table"),
        ({"index": 6}, "is not in the table"),
        ({"index": 13}, "is not in the table"),
        ({"index": -1}, "no proof"),
        ({"path": []}, "is not in the table"),
        ({"path": ["0" * 64] * 33}, "no proof"),
        ({"path": json.loads(DATA)["path"][::-1]}, "is not in the table"),
        ({"row": [CASE, "verdict/pass", "0" * 64, 5]}, "names a device class"),
        ({"head": {}}, "signature does not fit"),
        ({"key": signer(2).public}, "signature does not fit"),
        ({"format": "drivetwin certificate 1"}, "no proof"),
        ({"more": 1}, "no proof"),
    ],
)
def test_a_changed_proof(values, words):
    # The head has to keep its bytes, or the signature would not fit.
    head = b'"head":' + CERTIFICATE.signed
    data = changed(**values) if "head" in values else _with_head(changed(**values), head)
    assert words in refused(data)


def _with_head(data: bytes, head: bytes) -> bytes:
    value = json.loads(data)
    del value["head"]
    return b"{" + head + b"," + json.dumps(value).encode()[1:]


@pytest.mark.parametrize("data", [DATA + b"\n", DATA[:-1], DATA.replace(b",", b", ", 1)])
def test_a_proof_written_otherwise(data):
    assert "bytes were added or written otherwise" in refused(data)


def test_a_proof_of_somebody_else():
    assert "which is not trusted here" in refused(DATA, {signer(2).public})


def test_a_proof_has_a_bound(tmp_path):
    path = tmp_path / "p.json"
    path.write_bytes(DATA)
    assert read_proof(path, TRUSTED).row.case == CASE
    with path.open("ab") as file:
        file.truncate(FILE_BYTES_MAX + 1)
    with pytest.raises(UsageError, match="at most"):
        read_proof(path, TRUSTED)
