"""A store of each kind, and an S3 server for all tests of the folder."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from object_store import Wire, broken_wire, reached_by, s3_server

from twin.stores import url as url_module
from twin.stores.apart import StoreApart
from twin.stores.opening import open_store
from twin.stores.protocol import ResultStore


@pytest.fixture(scope="session")
def s3_port(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """Port of a server with an empty bucket."""
    pytest.importorskip("s3fs")
    with s3_server(tmp_path_factory.mktemp("s3") / "server.log") as port:
        yield port


@pytest.fixture
def wire(s3_port: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[Wire]:
    """The way to it, which may be broken; tries follow each other at once."""
    monkeypatch.setattr(url_module, "PAUSE_S", 0.001)
    with broken_wire(s3_port) as made:
        yield made


@pytest.fixture(params=["folder", "s3", "apart"])
def store(request: pytest.FixtureRequest, tmp_path: Path, s3_port: int) -> Iterator[ResultStore]:
    """An empty store."""
    if request.param == "folder":
        yield open_store(str(tmp_path / "store"))
        return
    if request.param == "apart":
        made = StoreApart(str(tmp_path / "store"))
        yield made
        made.close()
        return
    with reached_by(s3_port) as url:
        yield open_store(f"{url}/{tmp_path.name}")
