"""Timestamps (RFC 3161) by an authority that openssl plays."""

from __future__ import annotations

import base64
import shutil
import subprocess
from pathlib import Path

import msgspec
import pytest
from certificates import campaign, decoded, made

from conductor.certify.form import encode_certificate
from conductor.certify.timestamp import timestamp_of, with_timestamp
from twin.base.errors import InfrastructureError, UsageError

pytestmark = pytest.mark.skipif(shutil.which("openssl") is None, reason="needs openssl")
CERTIFICATE = made()
CONFIG = """
[req]
distinguished_name = name
[name]
[ca]
basicConstraints = critical,CA:true
keyUsage = critical,keyCertSign
[tsa]
basicConstraints = critical,CA:false
keyUsage = critical,digitalSignature
extendedKeyUsage = critical,timeStamping
[ts]
default_tsa = tsa_config
[tsa_config]
dir = .
serial = ./serial
crypto_device = builtin
signer_cert = ./tsa.pem
signer_key = ./tsa.key
signer_digest = sha256
default_policy = 1.2.3.4.1
digests = sha256, sha512
accuracy = secs:1
ess_cert_id_alg = sha256
"""


class Authority:
    """A timestamp authority with a root of its own."""

    def __init__(self, folder: Path, name: str) -> None:
        self.folder = folder
        folder.mkdir()
        (folder / "c.cnf").write_text(CONFIG)
        (folder / "serial").write_text("01\n")
        key = ("-newkey", "rsa:2048", "-nodes", "-config", "c.cnf")
        root = ("-x509", "-days", "30", "-extensions", "ca", "-subj", f"/CN={name} root")
        self.run("req", *key, *root, "-keyout", "ca.key", "-out", "ca.pem")
        self.run("req", *key, "-subj", f"/CN={name}", "-keyout", "tsa.key", "-out", "tsa.csr")
        signed = ("-CA", "ca.pem", "-CAkey", "ca.key", "-days", "30", "-set_serial", "7")
        ext = ("-extfile", "c.cnf", "-extensions", "tsa")
        self.run("x509", "-req", "-in", "tsa.csr", *signed, *ext, "-out", "tsa.pem")

    def run(self, *words: str) -> None:
        subprocess.run(["openssl", *words], cwd=self.folder, check=True, capture_output=True)

    def answer(self, data: bytes, *options: str) -> Path:
        """Its answer about a file."""
        (self.folder / "data").write_bytes(data)
        self.run("ts", "-query", "-data", "data", *options, "-cert", "-out", "q.tsq")
        conf = ("-config", "c.cnf", "-section", "tsa_config")
        self.run("ts", "-reply", "-queryfile", "q.tsq", *conf, "-out", "answer.tsr")
        return self.folder / "answer.tsr"


@pytest.fixture(scope="module")
def authority(tmp_path_factory):
    return Authority(tmp_path_factory.mktemp("tsa") / "one", "Time of One")


@pytest.mark.parametrize("digest", ["-sha256", "-sha512"])
def test_an_answer_is_attached_and_leads_to_its_authority(authority, digest):
    answer = authority.answer(encode_certificate(CERTIFICATE), digest)
    stamped = decoded(with_timestamp(CERTIFICATE, answer))
    assert stamped.head == CERTIFICATE.head
    found = timestamp_of(stamped, authority.folder / "ca.pem", "c.cert")
    assert found is not None
    assert found.authority == "CN=Time of One"
    unchecked = timestamp_of(stamped, None, "c.cert")
    assert unchecked is not None
    assert (unchecked.authority, unchecked.time) == ("", found.time)
    # Stamped again, it is the certificate that counts, without the first timestamp.
    assert with_timestamp(stamped, answer) == encode_certificate(stamped)


def test_an_answer_about_another_certificate(authority):
    answer = authority.answer(encode_certificate(made(campaign(9))), "-sha256")
    with pytest.raises(UsageError, match="is of another file than the certificate"):
        with_timestamp(CERTIFICATE, answer)
    moved = msgspec.structs.replace(
        CERTIFICATE, timestamp=base64.b64encode(answer.read_bytes()).decode()
    )
    with pytest.raises(InfrastructureError, match="is of another file than the certificate"):
        timestamp_of(decoded(encode_certificate(moved)), None, "c.cert")


def test_an_answer_of_another_authority(authority, tmp_path):
    answer = authority.answer(encode_certificate(CERTIFICATE), "-sha256")
    stamped = decoded(with_timestamp(CERTIFICATE, answer))
    other = Authority(tmp_path / "two", "Time of Two")
    with pytest.raises(InfrastructureError, match="is not signed by an authority of"):
        timestamp_of(stamped, other.folder / "ca.pem", "c.cert")


def test_a_changed_answer(authority):
    data = bytearray(authority.answer(encode_certificate(CERTIFICATE), "-sha256").read_bytes())
    data[-10] ^= 1  # of its signature
    changed = msgspec.structs.replace(CERTIFICATE, timestamp=base64.b64encode(data).decode())
    with pytest.raises(InfrastructureError, match="timestamp"):
        timestamp_of(changed, authority.folder / "ca.pem", "c.cert")


@pytest.mark.parametrize(
    "data", [b"", b"\x30", b"\x30\x82\xff\xff", b"0" * 1000, b"\x30\x80" * 5000]
)
def test_what_is_no_answer(tmp_path, data):
    path = tmp_path / "answer"
    path.write_bytes(data)
    with pytest.raises(UsageError, match="--timestamp"):
        with_timestamp(CERTIFICATE, path)


def test_files_that_are_missing_or_no_roots(authority, tmp_path):
    with pytest.raises(UsageError, match="--timestamp"):
        with_timestamp(CERTIFICATE, tmp_path / "none")
    with pytest.raises(UsageError, match="has no timestamp"):
        timestamp_of(CERTIFICATE, authority.folder / "ca.pem", "c.cert")
    assert timestamp_of(CERTIFICATE, None, "c.cert") is None
    stamped = decoded(
        with_timestamp(CERTIFICATE, authority.answer(encode_certificate(CERTIFICATE), "-sha256"))
    )
    (tmp_path / "roots").write_text("none")
    for name in ("roots", "missing"):
        with pytest.raises(UsageError, match="--tsa-root"):
            timestamp_of(stamped, tmp_path / name, "c.cert")
