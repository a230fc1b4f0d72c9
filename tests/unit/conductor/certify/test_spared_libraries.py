"""What a campaign's results depend on of the software, and what they do not."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from conductor.certify.spared import spared
from schemas.campaign import Campaign
from schemas.digest import digest
from schemas.files.software import (
    DECODERS,
    GPU_LIBRARIES,
    OPENCV,
    RUNTIMES,
    TRANSLATORS,
    differing,
    digest_of,
    is_digest_of,
)
from schemas.plan import parse_plan
from schemas.sections.stack_identity import StackIdentity
from twin.base.software import package_folder

WHOLE = {"type": "network", "model": "yolov3-w25-int8"}
FLOAT = {"type": "network", "model": "yolov3-w25"}
TRUTH = {"type": "ground_truth"}
NETWORKS = frozenset((OPENCV, *RUNTIMES, *GPU_LIBRARIES))
MESHES = frozenset(DECODERS)
BRIDGES = frozenset(TRANSLATORS)


def campaign(
    variants: dict[str, Any] | None = None,
    identity: StackIdentity | None = None,
    **autonomy: Any,
) -> Campaign:
    """A campaign of a shipped stack that says that it is portable."""
    data = {
        "campaign": "c",
        "autonomy": {"perception": variants or {"truth": TRUTH}, **autonomy},
        "matrix": {"model": list(variants or {"truth": TRUTH})},
    }
    plan, mistakes = parse_plan(data)
    assert plan is not None, mistakes
    identity = identity or StackIdentity(portable=True)
    return msgspec.structs.replace(plan.campaign, stack_identity=identity)


def test_truth_and_whole_numbers_need_no_runtime_and_no_decoder():
    for variants in ({"a": TRUTH}, {"a": WHOLE}, {"a": TRUTH, "b": WHOLE}):
        assert spared(campaign(variants), has_assets=False) == BRIDGES | NETWORKS | MESHES


def test_one_float_network_needs_its_runtime():
    both = campaign({"a": WHOLE, "b": FLOAT})
    assert spared(both, has_assets=False) == BRIDGES | MESHES


def test_a_stack_that_does_not_say_that_it_is_portable_may_use_a_runtime():
    assert spared(campaign(identity=StackIdentity()), has_assets=False) == BRIDGES | MESHES


def test_a_scene_of_somebody_may_need_a_decoder():
    assert spared(campaign(), has_assets=True) == BRIDGES | NETWORKS


@pytest.mark.parametrize(
    "campaign",
    [
        campaign(identity=StackIdentity("a" * 64, portable=True)),
        campaign(command=["./stack"]),
        campaign(files=["helper.py"]),
        campaign(bridge="ros2", parameters={"keys": "keys"}, sandbox="off"),
        campaign(placement="node"),
        msgspec.structs.replace(campaign(), plugins={"mine": "1.0"}),
    ],
    ids=["class", "command", "files", "bridge", "node", "plug-in"],
)
def test_what_somebody_else_wrote_may_use_whatever_is_installed(campaign):
    assert spared(campaign, has_assets=False) == frozenset()


def test_no_file_that_ships_is_compressed_for_a_decoder():
    suffixes = {".glb", ".gltf", ".ktx2", ".drc"}
    for package in ("schemas", "twin", "devkit"):
        paths = [p for p in package_folder(package).rglob("*") if p.is_file()]
        assert len(paths) > 50
        assert not [path for path in paths if path.suffix in suffixes]


def test_every_part_counts_in_the_digest_and_no_order():
    files, libraries = {"a.py": "1", "b.py": "2"}, {"numpy": "2.4", "onnx": "1"}
    whole = digest_of(files, libraries)
    others = {
        digest_of({"a.py": "2", "b.py": "2"}, libraries),
        digest_of({"a.py": "1"}, libraries),
        digest_of(files, {"numpy": "2.4"}),
        digest_of(files, {"numpy": "2.5", "onnx": "1"}),
        digest_of(files | {"c.py": "3"}, libraries),
    }
    assert len(others | {whole}) == 6
    assert whole == digest_of(dict(reversed(files.items())), dict(reversed(libraries.items())))


def test_what_differs_by_name():
    before = {"a": "1", "b": "2", "c": "3"}
    assert differing(before, before) == []
    assert differing(before, {"a": "1", "b": "5", "d": "4"}) == ["b", "c", "d"]
    assert differing(before, {"a": "1", "b": "5", "d": "4"}, frozenset("bd")) == ["c"]


def test_opencv_is_no_part_of_the_digest_and_was_one():
    files, libraries = {"a.py": "1"}, {"numpy": "2.4"}
    now = digest_of(files, libraries)
    assert digest_of(files, libraries | {OPENCV: "5.0"}) == now
    assert is_digest_of(now, files, libraries | {OPENCV: "5.0"})
    before = digest_of(files, libraries | {"opencv": "5.0"})
    assert not is_digest_of(before, files, libraries)
    then = digest([b"a.py=1", b"numpy==2.4", f"{OPENCV}==5.0".encode()])
    assert is_digest_of(then, files, libraries | {OPENCV: "5.0"})
    assert not is_digest_of(then, files, libraries | {OPENCV: "5.1"})
    assert not is_digest_of(then, files, libraries)
