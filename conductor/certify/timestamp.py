"""A timestamp (RFC 3161) of a certificate: an authority's word that it existed at a time.

The authority signs the digest of the certificate's file as `conductor certify` wrote it. Its answer
is attached beside the signature, which does not cover it. Nothing here uses a network.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
from msgspec import Struct

from conductor.certify.form import TOKEN_CHARS_MAX, Certificate, encode_certificate
from conductor.certify.given import read_given
from schemas.escape import escape
from twin.base.errors import InfrastructureError, UsageError

if TYPE_CHECKING:
    from rfc3161_client import TimeStampResponse

ROOT_BYTES_MAX = 1 << 20
"""Largest file of an authority's root certificates [bytes]."""
MISSING = "timestamps need the package rfc3161-client: pip install 'drivetwin[timestamp]'"
_ALGORITHMS = {
    "2.16.840.1.101.3.4.2.1": "sha256",
    "2.16.840.1.101.3.4.2.2": "sha384",
    "2.16.840.1.101.3.4.2.3": "sha512",
}
"""Object identifiers of the digests that an authority may have signed."""


class Timestamp(Struct, frozen=True):
    """What an authority has said."""

    time: str
    """When the certificate existed, UTC."""
    authority: str
    """Name in the certificate of the authority that was checked; empty: it was not."""

    @property
    def words(self) -> str:
        """A line for people."""
        by = f"by {self.authority}" if self.authority else "by nobody knows whom; give --tsa-root"
        return f"existed at {self.time}, {by}"


def with_timestamp(certificate: Certificate, answer: Path) -> bytes:
    """The file of a certificate with the answer of an authority, a DER file, attached.

    Raises:
        UsageError: it is no such answer, or about something else.
    """
    data = read_given(answer, TOKEN_CHARS_MAX // 4 * 3, "--timestamp")
    bare = msgspec.structs.replace(certificate, timestamp="")
    try:
        _stamped(bare, data, f"--timestamp {answer}")
    except InfrastructureError as error:
        raise UsageError(str(error)) from None
    attached = msgspec.structs.replace(bare, timestamp=base64.b64encode(data).decode())
    return encode_certificate(attached)


def timestamp_of(certificate: Certificate, roots: Path | None, shown: str) -> Timestamp | None:
    """What the timestamp of a certificate says; None: it has none.

    Args:
        certificate: the certificate.
        roots: PEM file of the authority's root certificates; None: the authority is not checked.
        shown: name of the certificate.

    Raises:
        UsageError: the package for timestamps, or the file of roots, is missing.
        InfrastructureError: the timestamp is of something else, or not of this authority.
    """
    if not certificate.timestamp:
        if roots is not None:
            raise UsageError(f"{shown}: has no timestamp that --tsa-root could check")
        return None
    try:
        data = base64.b64decode(certificate.timestamp, validate=True)
    except binascii.Error:
        raise InfrastructureError(f"{shown}: its timestamp is damaged") from None
    response = _stamped(certificate, data, shown)
    time = f"{response.tst_info.gen_time:%Y-%m-%dT%H:%M:%SZ}"
    if roots is None:
        return Timestamp(time, "")
    return Timestamp(time, _authority(certificate, response, roots, shown))


def _stamped(certificate: Certificate, data: bytes, shown: str) -> TimeStampResponse:
    """An authority's answer, about the certificate's file without it."""
    try:
        from rfc3161_client import decode_timestamp_response
    except ModuleNotFoundError:
        raise UsageError(MISSING) from None
    try:
        response = decode_timestamp_response(data)
        imprint = response.tst_info.message_imprint
        algorithm, stamped = imprint.hash_algorithm.dotted_string, bytes(imprint.message)
    except Exception as error:  # of a foreign decoder, which raises many things
        raise InfrastructureError(
            f"{shown}: no timestamp response (RFC 3161, DER): {escape(str(error), 200)}"
        ) from None
    name = _ALGORITHMS.get(algorithm)
    if name is None:
        raise InfrastructureError(f"{shown}: a timestamp by digest {algorithm}; SHA-256 is needed")
    if hashlib.new(name, _bare(certificate)).digest() != stamped:
        raise InfrastructureError(f"{shown}: the timestamp is of another file than the certificate")
    return response


def _authority(
    certificate: Certificate, response: TimeStampResponse, roots: Path, shown: str
) -> str:
    """The name of the authority whose signature was checked up to one of the roots."""
    from cryptography import x509
    from rfc3161_client import VerifierBuilder

    data = read_given(roots, ROOT_BYTES_MAX, "--tsa-root")
    try:
        builder = VerifierBuilder()
        for root in x509.load_pem_x509_certificates(data):
            builder = builder.add_root_certificate(root)
    except ValueError:
        raise UsageError(f"--tsa-root {roots}: no certificates in PEM") from None
    try:
        builder.build().verify_message(response, _bare(certificate))
        signers = {(s.issuer, s.serial_number) for s in response.signed_data.signer_infos}
        known = map(x509.load_der_x509_certificate, response.signed_data.certificates)
        names = [c.subject for c in known if (c.issuer, c.serial_number) in signers]
        return escape(names[0].rfc4514_string(), 200) if names else "an authority without a name"
    except Exception as error:  # of a foreign verifier
        raise InfrastructureError(
            f"{shown}: its timestamp is not signed by an authority of {roots}: "
            f"{escape(str(error), 200)}"
        ) from None


def _bare(certificate: Certificate) -> bytes:
    return encode_certificate(msgspec.structs.replace(certificate, timestamp=""))
