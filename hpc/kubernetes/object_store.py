"""A run with journal and results in an object store: its directives, and what its pods get. Pure.

The conductor's pod has an empty disk then, and another one, on any node, goes on with what is in
the store (:mod:`conductor.stored`). Credentials are files of a Secret that is there already; ours
is never a copy of the user's own, and none is in a variable, a command line or an object of ours.
"""

from __future__ import annotations

import ipaddress
import re
from typing import Any, Protocol
from urllib.parse import urlsplit

from twin.base.errors import UsageError
from twin.stores.opening import checked_url

Part = dict[str, Any]
"""Part of an object as the API takes it."""

MOUNT = "/store"
"""Folder of the Secret's files in a pod."""
CREDENTIALS, SETTINGS = "credentials", "config"
"""Files of the Secret: what proves who asks, and (S3) region and the like."""
STORE = "drivetwin/store"
"""Annotation of a conductor's Job: where the results are."""
DURABLE = ("local", "store")
"""What a reply of the conductor may wait for."""

_PLACE = re.compile(r"[a-z0-9][a-z0-9._-]{1,61}[a-z0-9](/[A-Za-z0-9_-][A-Za-z0-9._-]*)*/?")
_HOST = re.compile(r"[A-Za-z0-9][A-Za-z0-9.-]{0,252}")
_URL_CHARS_MAX = 500
"""Longest URL; the name of a run is added to it [characters]."""

_VARIABLES = {
    "s3": {
        "AWS_SHARED_CREDENTIALS_FILE": f"{MOUNT}/{CREDENTIALS}",
        "AWS_CONFIG_FILE": f"{MOUNT}/{SETTINGS}",
        # Nodes of clouds give everybody their own rights; a run has those of its Secret.
        "AWS_EC2_METADATA_DISABLED": "true",
    },
    "gs": {"GOOGLE_APPLICATION_CREDENTIALS": f"{MOUNT}/{CREDENTIALS}"},
}
"""Variables by scheme that say where the files are."""


class StoreDirectives(Protocol):
    """What a job's directives say of a store; one of their options of a job."""

    @property
    def store(self) -> str:
        """URL; empty: a claim."""

    @property
    def store_secret(self) -> str:
        """Secret of the namespace."""

    @property
    def store_endpoint(self) -> str:
        """Server; empty: Amazon's."""

    @property
    def store_network(self) -> str:
        """Network of its addresses; empty: any."""

    @property
    def storage_class(self) -> str:
        """Of a claim."""

    @property
    def durable(self) -> str:
        """What replies wait for; empty: the default."""


def check_url(name: str, value: str) -> None:
    """``s3://BUCKET/PREFIX`` or ``gs://BUCKET/PREFIX``.

    Raises:
        UsageError: it is something else; what may be a secret is not repeated.
    """
    scheme, _, place = value.partition("://")
    if scheme in _VARIABLES:
        checked_url(value)  # its line hides credentials
        if len(value) <= _URL_CHARS_MAX and _PLACE.fullmatch(place):
            return
        raise UsageError(
            f"--{name} {scheme}://...: expected {scheme}://BUCKET/PREFIX of letters, digits and "
            f"any of . _ -, at most {_URL_CHARS_MAX} characters"
        )
    schemes = " or ".join(f"{scheme}://BUCKET/PREFIX" for scheme in _VARIABLES)
    raise UsageError(f"--{name}: pods reach no other store than {schemes}")


def check_endpoint(name: str, value: str) -> None:
    """Address of a server that speaks the protocol of S3.

    Raises:
        UsageError: it is something else.
    """
    if _endpoint(value) is None:
        raise UsageError(
            f"--{name}: expected http://HOST:PORT or https://HOST:PORT and nothing else; "
            "credentials belong into the Secret"
        )


def check_network(name: str, value: str) -> None:
    """A network of IPv4 addresses.

    Raises:
        UsageError: it is something else.
    """
    try:
        ipaddress.IPv4Network(value)
    except ValueError:
        raise UsageError(
            f"--{name} {value[:80]!r}: expected the network of the store's addresses, e.g. "
            "10.1.0.0/16"
        ) from None


def check_durable(name: str, value: str) -> None:
    """One of :data:`DURABLE`.

    Raises:
        UsageError: it is something else.
    """
    if value not in DURABLE:
        raise UsageError(f"--{name} {value[:80]!r}: expected one of {', '.join(DURABLE)}")


def check_together(options: StoreDirectives) -> None:
    """What is said of a store belongs together.

    Raises:
        UsageError: something is missing, or has no meaning.
    """
    if not options.store:
        given = {
            "--store-secret": options.store_secret,
            "--store-endpoint": options.store_endpoint,
            "--store-network": options.store_network,
            "--durable": options.durable,
        }
        if lone := [name for name, value in given.items() if value]:
            raise UsageError(f"{lone[0]}: belongs to --store=URL; give both or none")
        return
    if not options.store_secret:
        raise UsageError(
            f"--store: also give --store-secret=NAME, a Secret of the namespace with a file "
            f"{CREDENTIALS}: kubectl create secret generic NAME --from-file={CREDENTIALS}=FILE"
        )
    if options.storage_class:
        raise UsageError("--storage-class: with --store there is no claim; leave one of them away")
    if options.store_endpoint and not options.store.startswith("s3:"):
        raise UsageError("--store-endpoint: is for s3:// alone; leave it away")


def url_of(options: StoreDirectives, run: str) -> str:
    """Where the results of a run are: below what was given, since a store belongs to one run."""
    return f"{options.store.rstrip('/')}/{run}"


def words(options: StoreDirectives, run: str) -> list[str]:
    """Words of the conductor's command."""
    durable = ["--durable", options.durable] if options.durable else []
    return ["--store", url_of(options, run), *durable]


def volume(options: StoreDirectives) -> Part:
    """The Secret as a volume of a pod; its group may read it."""
    secret = {"secretName": options.store_secret, "defaultMode": 0o440}
    return {"name": "store", "secret": secret}


def add_to(container: Part, options: StoreDirectives) -> None:
    """Let a container see the Secret's files, and say where they are."""
    variables = dict(_VARIABLES[options.store.partition(":")[0]])
    if options.store_endpoint:
        variables["AWS_ENDPOINT_URL"] = options.store_endpoint
    container["env"] += [{"name": name, "value": value} for name, value in variables.items()]
    container["volumeMounts"].append({"name": "store", "mountPath": MOUNT, "readOnly": True})


def way(options: StoreDirectives) -> Part:
    """Rule of a network policy: the store's port, and its network where that is known."""
    found = _endpoint(options.store_endpoint) if options.store_endpoint else ("", 443)
    assert found is not None
    rule: Part = {"ports": [{"protocol": "TCP", "port": found[1]}]}
    if options.store_network:
        rule = {"to": [{"ipBlock": {"cidr": options.store_network}}], **rule}
    return rule


def _endpoint(text: str) -> tuple[str, int] | None:
    """Host and port of an endpoint, or None."""
    try:
        parts = urlsplit(text)
        usual = {"https": 443, "http": 80}.get(parts.scheme, 0)
        port = usual if parts.port is None else parts.port
    except ValueError:
        return None
    plain = f"{parts.scheme}://{parts.netloc}"
    if (
        not usual
        or not port
        or text.rstrip("/") != plain
        or not _HOST.fullmatch(parts.hostname or "")
    ):
        return None
    return (parts.hostname or "", port) if "@" not in parts.netloc else None
