"""Whether a store has winners, where some of what is written arrives in part."""

from pathlib import Path

import pytest

from twin.stores.folder import FolderStore
from twin.stores.opening import has_winners
from twin.stores.protocol import StoreError


class InPart(FolderStore):
    """The first ``halves`` objects that are created arrive in part."""

    def __init__(self, folder: Path, halves: int) -> None:
        super().__init__(folder)
        self.halves = halves

    def create(self, name: str, data: bytes) -> bool:
        if self.halves == 0 or self.names(name):
            return super().create(name, data)
        self.halves -= 1
        super().create(name, data[: len(data) // 2])
        return False


def test_an_object_that_arrived_in_part_says_nothing(tmp_path: Path) -> None:
    store = InPart(tmp_path, 2)
    assert has_winners(store)
    assert store.names("probe/") == []


def test_a_store_in_which_nothing_arrives_as_it_was_written(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="is not what was written; try again"):
        has_winners(InPart(tmp_path, 1000))
