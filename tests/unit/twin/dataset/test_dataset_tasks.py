"""Who renders which images of a dataset: everything once, few streets for each, nothing lost."""

from __future__ import annotations

from collections import Counter

import pytest

from twin.base.errors import InfrastructureError
from twin.dataset.crew.task import IMAGES, Agenda, Task, divided
from twin.dataset.folder import Folder, Maker
from twin.dataset.recipe import DatasetRecipe


def test_tasks_hold_whole_batches():
    tasks = divided("train", 0, 1, range(100), 12)
    assert [len(task.indices) for task in tasks] == [24, 24, 24, 24, 4]
    assert [i for task in tasks for i in task.indices] == list(range(100))
    assert [len(task.indices) for task in divided("train", 0, 1, range(130), 64)] == [64, 64, 2]
    assert [len(task.indices) for task in divided("train", 0, 1, range(40), 1)] == [IMAGES, 8]
    assert divided("train", 0, 1, [], 4) == []


def tasks_of(streets, eyes, images):
    first = 0
    for street in range(streets):
        for eye in range(eyes):
            yield from divided("train", street, eye, range(first, first + images), 1)
            first += images


def test_everything_is_handed_out_once_and_few_change_streets():
    agenda, changes = Agenda(tasks_of(6, 4, 96)), Counter()
    seen, at = [], {}
    while len(agenda):
        for who in range(8):
            task = agenda.take(who)
            if task is None:
                continue
            seen += task.indices
            changes[who] += at.get(who) not in (None, task.place)
            at[who] = task.place
    assert sorted(seen) == list(range(6 * 4 * 96))
    assert all(agenda.take(who) is None for who in range(8))
    assert max(changes.values()) <= 2


def test_all_streets_are_begun_before_one_is_shared():
    agenda = Agenda(tasks_of(3, 2, 64))
    places = [agenda.take(who).place for who in range(6)]
    assert Counter(places) == {("train", street): 2 for street in range(3)}


def test_the_camera_stays_while_it_has_images():
    agenda = Agenda(
        [Task("train", 0, 1, (0,)), Task("train", 0, 2, (1,)), Task("train", 0, 1, (2,))]
    )
    assert [agenda.take(0).eye for _ in range(3)] == [1, 1, 2]


def test_what_a_power_cut_leaves_is_missing_or_named(tmp_path):
    recipe = DatasetRecipe(count=3)
    folder = Folder(tmp_path / "d")
    assert not folder.open(recipe, Maker("s", "cpu"))
    for index in range(3):
        folder.write(recipe, "train", index, b"picture", {"image": {"index": index}})
    assert [folder.done(recipe, "train", index) for index in range(4)] == [True] * 3 + [False]
    folder.image_path(recipe, "train", 0).write_bytes(b"")
    folder.part_path("train", 1).write_bytes(b"")
    assert [folder.done(recipe, "train", index) for index in range(3)] == [False, False, True]
    assert folder.read_part("train", 2) == {"image": {"index": 2}}
    folder.part_path("train", 2).write_bytes(b'{"image": {"ind')
    with pytest.raises(InfrastructureError, match=r"train-000002\.json: damaged") as caught:
        folder.read_part("train", 2)
    assert "\n" not in str(caught.value)
