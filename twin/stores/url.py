"""Object stores behind URLs, by fsspec: S3, Google Cloud Storage, SFTP.

Credentials and endpoints come from the environment (``AWS_ACCESS_KEY_ID``, ``AWS_ENDPOINT_URL``)
or fsspec's configuration files, never from the URL.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import Any, TypeVar

from schemas.escape import escape
from schemas.kinds.result_store import EXTRA
from twin.base.errors import UsageError
from twin.stores.protocol import (
    SMALL_BYTES_MAX,
    DamagedObjectError,
    MissingObjectError,
    StoreError,
    StoreRefusedError,
)

T = TypeVar("T")

TRIES = 5
"""How often an operation is tried before it has failed."""
PAUSE_S = 0.1
"""Pause before the second try; each further one is twice as long [s]."""
TIMEOUT_S = 10.0
"""Longest wait for a connection and for each answer [s]."""
REASON_CHARS_MAX = 200
"""Most that is told of a library's error [characters]."""

_OPTIONS: dict[str, dict[str, Any]] = {
    "s3": {
        "config_kwargs": {
            "connect_timeout": TIMEOUT_S,
            "read_timeout": TIMEOUT_S,
            "retries": {"total_max_attempts": 1, "mode": "standard"},
        },
    },
}
"""Options of fsspec's file systems by scheme; tries are ours, so that each is bounded."""


def open_url(url: str) -> UrlStore:
    """The store at ``url``; nothing is asked of it yet.

    Raises:
        UsageError: a package is missing, or fsspec refuses the URL.
    """
    # What the library logs of a failed request may hold signed headers.
    for name in ("botocore", "aiobotocore", "s3fs", "fsspec"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    scheme, _, place = url.partition("://")
    try:
        import fsspec

        options = {"skip_instance_cache": True, "use_listings_cache": False}
        if scheme == "s3":
            options |= _OPTIONS["s3"]
            system = fsspec.filesystem("s3", **options)
            system.retries = 1
        else:
            system, place = fsspec.url_to_fs(url, **options)
    except ImportError as error:
        raise UsageError(f"{url}: {escape(str(error), REASON_CHARS_MAX)}; {EXTRA}") from None
    except Exception as error:
        why = escape(str(error), REASON_CHARS_MAX)
        raise UsageError(f"{url}: cannot be opened: {why}; check URL and credentials") from None
    return UrlStore(url, system, place)


class UrlStore:
    """See :class:`twin.stores.protocol.ResultStore`.

    Args:
        url: how a user names it.
        system: fsspec's file system.
        place: path of the store in it.
    """

    def __init__(self, url: str, system: Any, place: str) -> None:
        self.url = url.rstrip("/")
        self._system = system
        self._place = place.rstrip("/")

    def put(self, name: str, data: bytes) -> None:
        """See the protocol. What was written is looked at before it counts."""

        def write() -> None:
            path = self._path(name, folders=True)
            self._system.pipe_file(path, data)
            self._check_size(path, data)

        self._try(f"put {name}", write)

    def create(self, name: str, data: bytes) -> bool:
        """See the protocol."""

        def write() -> bool:
            path = self._path(name, folders=True)
            try:
                self._system.pipe_file(path, data, mode="create")
            except FileExistsError:
                # Ours, if the answer to an earlier try was lost.
                return self._holds(path, data)
            return self._holds(path, data)

        return self._try(f"create {name}", write)

    def get(self, name: str, size_max: int = SMALL_BYTES_MAX) -> bytes:
        """See the protocol."""

        def read() -> bytes:
            return bytes(self._system.cat_file(self._path(name), start=0, end=size_max + 1))

        data = self._try(f"get {name}", read)
        if len(data) > size_max:
            raise DamagedObjectError(f"{self.url}/{name}: more than {size_max} bytes")
        return data

    def names(self, prefix: str) -> list[str]:
        """See the protocol."""

        def read() -> list[str]:
            try:
                found = self._system.find(self._path(prefix.rstrip("/")))
            except FileNotFoundError:
                return []
            return sorted(str(path)[len(self._place) + 1 :] for path in found)

        return self._try(f"list {prefix}", read)

    def delete(self, name: str) -> None:
        """See the protocol."""

        def remove() -> None:
            try:
                self._system.rm_file(self._path(name))
            except FileNotFoundError:
                pass

        self._try(f"delete {name}", remove)

    def _path(self, name: str, *, folders: bool = False) -> str:
        path = f"{self._place}/{name}"
        if folders and self._system.protocol in ("sftp", ("sftp", "ssh")):
            self._system.makedirs(path.rpartition("/")[0], exist_ok=True)
        return path

    def _holds(self, path: str, data: bytes) -> bool:
        """Whether an object that was created is ours, and whole; no other try can mend it."""
        try:
            return bool(self._system.cat_file(path) == data)
        except Exception as error:  # the library's own
            if "checksum" in str(error).lower():
                return False
            raise

    def _check_size(self, path: str, data: bytes) -> None:
        size = self._system.info(path)["size"]
        if size != len(data):
            raise OSError(f"{size} of {len(data)} bytes were written")

    def _try(self, what: str, operation: Callable[[], T]) -> T:
        pause_s = PAUSE_S
        for tries_left in reversed(range(TRIES)):
            try:
                return operation()
            except FileNotFoundError as error:
                if "bucket" in str(error).lower():
                    raise self._refused("there is no such bucket") from None
                if what.startswith("get "):
                    raise MissingObjectError(f"{self.url}: {what}: is not there") from None
                reason = str(error)
            except PermissionError as error:
                raise self._refused(_reason(error)) from None
            except Exception as error:  # a library's own, whichever store it is
                if type(error).__name__ in ("NoCredentialsError", "PartialCredentialsError"):
                    raise self._refused("no credentials") from None
                reason = _reason(error)
            if tries_left:
                time.sleep(pause_s)
                pause_s *= 2
        if what.startswith("get ") and "checksum" in reason.lower():
            raise DamagedObjectError(f"{self.url}: {what}: {reason}")
        raise StoreError(
            f"{self.url}: {what}: {reason or 'no answer'}, tried {TRIES} times; it will be tried "
            "again"
        )

    def _refused(self, why: str) -> StoreRefusedError:
        return StoreRefusedError(
            f"{self.url}: {why}; check the bucket and the credentials in the environment or "
            "fsspec's configuration"
        )


def _reason(error: BaseException) -> str:
    """What went wrong, in a few words; of a signed address only the first part."""
    return escape(str(error).partition("?")[0] or type(error).__name__, REASON_CHARS_MAX)
