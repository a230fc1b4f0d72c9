"""Files of a dataset: the same bytes however it was made, and what they say about themselves."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import shutil
import signal
from pathlib import Path

import cv2
import pytest
import yaml

from schemas.messages import OBJECT_CLASSES
from twin.base.errors import InfrastructureError, UsageError
from twin.dataset.command import DatasetRequest, run_dataset, show_dataset
from twin.dataset.crew.making import make_dataset
from twin.dataset.recipe import SPLITS, DatasetRecipe, Shares, Streets

pytestmark = pytest.mark.slow

RECIPE = DatasetRecipe(
    seed=6,
    count=14,
    width=128,
    height=72,
    cameras=2,
    split_shares=Shares(0.72, 0.14, 0.14),
    streets=Streets(1, 1, 1),
)


def quiet(done, total):
    """Nobody watches."""


def digests(folder):
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("dataset") / "one"
    make_dataset(folder, RECIPE, slots=1, device="cpu", report=quiet)
    return folder


@pytest.mark.parametrize("slots", [3, 8])
def test_the_same_bytes_whatever_the_batch(made, tmp_path, slots):
    make_dataset(tmp_path / "d", RECIPE, slots=slots, device="cpu", report=quiet)
    assert digests(tmp_path / "d") == digests(made)
    assert len(digests(made)) == RECIPE.count + len(SPLITS) + 1


@pytest.mark.slow
def test_the_same_bytes_after_interruptions(made, tmp_path):
    folder = tmp_path / "d"
    for stop in (2, 9):

        def interrupt(done, total, stop=stop):
            if done == stop:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            make_dataset(folder, RECIPE, slots=4, device="cpu", report=interrupt)
        assert yaml.safe_load((folder / "dataset.yaml").read_text())["complete"] is False
    (folder / "images" / "train" / ".000001.jpg.dead.tmp").write_bytes(b"half")
    lost = next((folder / "images" / "train").glob("0*.jpg"))
    lost.unlink()
    first = []
    make_dataset(
        folder, RECIPE, slots=2, device="cpu", report=lambda done, total: first.append(done)
    )
    assert first[0] == 8  # nine less the one that was lost
    assert digests(folder) == digests(made)


def test_a_complete_dataset_is_left_alone(made):
    before = digests(made)
    seen = []
    found = run_dataset(DatasetRequest(out=made, plain={"count": None}))
    make_dataset(made, RECIPE, slots=1, device="cpu", report=lambda *a: seen.append(a))
    assert not seen
    assert found["complete"] is True
    assert digests(made) == before


def test_other_parameters_are_refused_by_name(made, tmp_path):
    with pytest.raises(UsageError, match="begun with count 14, given 15") as caught:
        run_dataset(DatasetRequest(out=made, plain={"count": 15}))
    assert "\n" not in str(caught.value)
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(UsageError, match=r"holds no dataset\.yaml"):
        run_dataset(DatasetRequest(out=tmp_path, plain={}))
    assert [p.name for p in tmp_path.iterdir()] == ["notes.txt"]


@pytest.mark.parametrize(
    ("request_", "said"),
    [
        ({"size": "320"}, "--size"),
        ({"split_shares": "0.5,0.5"}, "--split-shares"),
        ({"streets": "a,b,c"}, "--streets"),
        ({"rules": ("visibility_min",)}, "--rule"),
        ({"rules": ("visibility=0.3",)}, "visibility"),
        ({"plain": {"scene": "nowhere"}}, "nowhere"),
        ({"plain": {"vehicle": "tank"}}, "tank"),
        ({"plain": {"camera": "rear"}}, "rear"),
        ({"device": "cuda:99"}, "cuda:99"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(tmp_path, request_, said):
    with pytest.raises(UsageError) as caught:
        run_dataset(DatasetRequest(**{"out": tmp_path / "d", "plain": {}, **request_}))
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "d").exists()


def test_annotations_agree_with_themselves(made):
    images, boxes, labels = {}, [], 0
    for split, count in RECIPE.counts().items():
        document = json.loads((made / "annotations" / f"{split}.json").read_text())
        assert [row["name"] for row in document["categories"]] == list(OBJECT_CLASSES)
        assert len(document["images"]) == count
        for image in document["images"]:
            assert image["id"] not in images
            assert image["split"] == split
            assert image["camera"] in document["info"]["cameras"]
            images[image["id"]] = image
            picture = cv2.imread(str(made / "images" / image["file_name"]))
            assert picture.shape == (image["height"], image["width"], 3)
        for row in document["annotations"]:
            assert images[row["image_id"]]["split"] == split
            assert 1 <= row["category_id"] <= len(OBJECT_CLASSES)
            boxes.append(row)
            labels += not row["ignore"]
    assert len(images) == RECIPE.count
    assert len({row["id"] for row in boxes}) == len(boxes)
    assert labels > 10
    for row in boxes:
        x, y, width, height = row["bbox"]
        assert 0 <= x < x + width <= RECIPE.width
        assert 0 <= y < y + height <= RECIPE.height
        assert 1 <= row["area"] == row["visible_px"] <= width * height
        assert row["visible_px"] <= row["unoccluded_px"]
        assert row["ignore"] == row["iscrowd"] == int(bool(row["ignored_for"]))
        fx, fy, fw, fh = row["full_bbox"]
        assert fx <= x
        assert fy <= y
        assert fx + fw >= x + width
        assert fy + fh >= y + height


def test_the_head_counts_what_is_there(made):
    head = yaml.safe_load((made / "dataset.yaml").read_text())
    for split in SPLITS:
        document = json.loads((made / "annotations" / f"{split}.json").read_text())
        counts = head["counts"][split]
        assert counts["images"] == len(document["images"])
        total = sum(counts["labels"].values()) + sum(counts["ignored"].values())
        assert total == len(document["annotations"])
    assert len(head["software"]) == 64


def test_the_tally_is_that_of_the_annotations(made, capsys):
    show_dataset(DatasetRequest(out=made, plain={}), as_json=True)
    found = json.loads(capsys.readouterr().out)
    head = yaml.safe_load((made / "dataset.yaml").read_text())["counts"]
    assert found["images"] == {split: head[split]["images"] for split in SPLITS}
    for kind in ("labels", "ignored"):
        assert found[kind]["split"] == {split: head[split][kind] for split in SPLITS}
        for groups in found[kind].values():
            for name in OBJECT_CLASSES:
                total = sum(counts[name] for counts in groups.values())
                assert total == sum(head[split][kind][name] for split in SPLITS)
    rows = []
    for split in SPLITS:
        rows += json.loads((made / "annotations" / f"{split}.json").read_text())["annotations"]
    low = [r for r in rows if r["category_id"] == 1 and not r["ignore"] and r["bbox"][3] < 8]
    assert found["labels"]["height_px"].get("< 8", {}).get("car", 0) == len(low)
    small = [r for r in rows if r["category_id"] == 6 and "small" in r["ignored_for"]]
    assert found["ignored_for"]["traffic_sign"]["small"] == len(small) > 0
    show_dataset(DatasetRequest(out=made, plain={}), as_json=False)
    text = capsys.readouterr().out
    assert "ignored for small" in text
    assert text.splitlines()[-1] == str(made)


def test_a_sheet_shows_the_boxes(made, tmp_path):
    sheet = tmp_path / "sheet.png"
    run_dataset(DatasetRequest(out=made, plain={}, preview=sheet))
    green = (cv2.imread(str(sheet)) == (80, 220, 80)).all(axis=-1)
    assert green.sum() > 100
    with pytest.raises(UsageError, match="ends in"):
        run_dataset(DatasetRequest(out=made, plain={}, preview=tmp_path / "sheet.gif"))


STRANGERS = set()
"""Processes of other tests' fixtures, such as a browser."""


def children():
    """Processes that this one has started meanwhile."""
    found = []
    for path in Path("/proc/self/task").glob("*/children"):
        with contextlib.suppress(OSError):  # the thread has ended
            found += [int(pid) for pid in path.read_text().split()]
    return [pid for pid in found if pid not in STRANGERS]


@pytest.fixture(autouse=True)
def _strangers():
    STRANGERS.clear()
    STRANGERS.update(children())


@pytest.mark.slow
def test_the_same_bytes_by_several_processes(made, tmp_path):
    seen = []
    make_dataset(
        tmp_path / "d", RECIPE, slots=2, jobs=3, device="cpu", report=lambda *a: seen.append(a)
    )
    assert seen == [(done, RECIPE.count) for done in range(RECIPE.count + 1)]
    assert digests(tmp_path / "d") == digests(made)
    assert not children()


@pytest.mark.slow
def test_interrupts_and_dead_processes_leave_nothing_and_it_goes_on(made, tmp_path):
    folder = tmp_path / "d"

    def interrupt(done, total):
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        make_dataset(folder, RECIPE, slots=1, jobs=2, device="cpu", report=interrupt)
    assert not children()
    assert not list(folder.rglob(".*.tmp"))
    first = []

    def kill(done, total):
        first.append(done)
        if len(first) == 3:
            os.kill(children()[0], signal.SIGKILL)

    with pytest.raises(InfrastructureError, match="killed by SIGKILL") as caught:
        make_dataset(folder, RECIPE, slots=1, jobs=2, device="cpu", report=kill)
    assert "\n" not in str(caught.value)
    assert first[0] >= 2
    assert not children()
    assert not list(folder.rglob(".*.tmp"))
    make_dataset(folder, RECIPE, slots=1, device="cpu", report=quiet)
    assert digests(folder) == digests(made)


def test_what_a_process_cannot_do_is_one_line(tmp_path):
    folder = tmp_path / "d"

    def spoil(done, total):
        shutil.rmtree(folder / "images" / "train", ignore_errors=True)

    with pytest.raises(InfrastructureError, match="images/train") as caught:
        make_dataset(folder, RECIPE, slots=1, jobs=2, device="cpu", report=spoil)
    assert "\n" not in str(caught.value)
    assert not children()
