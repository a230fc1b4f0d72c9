"""What is kept beside the kernels: found again, never trusted when damaged, never needed."""

import numpy as np
import pytest

from twin.world import kept as module
from twin.world.kept import ENTRIES_MAX, kept
from twin.world.scene import load_scene
from twin.world.sky import atmosphere
from twin.world.street.build import _build, build_world


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "kept_folder", lambda name: tmp_path / name)
    return tmp_path / "things"


def counted(value):
    calls = []

    def make():
        calls.append(1)
        return value

    return make, calls


def test_the_second_time_it_is_found(folder):
    make, calls = counted({"a": np.arange(5)})
    first = kept("things", b"k", make)
    second = kept("things", b"k", make)
    assert len(calls) == 1
    assert (first["a"] == second["a"]).all()
    kept("things", b"other", make)
    assert len(calls) == 2


@pytest.mark.parametrize(
    "damage", [lambda b: b[:-1], lambda b: b[:40] + b"x" + b[41:], lambda b: b""]
)
def test_a_damaged_entry_is_made_anew(folder, damage):
    make, calls = counted([1, 2, 3])
    kept("things", b"k", make)
    (entry,) = folder.iterdir()
    entry.write_bytes(damage(entry.read_bytes()))
    assert kept("things", b"k", make) == [1, 2, 3]
    assert len(calls) == 2
    assert kept("things", b"k", make) == [1, 2, 3]
    assert len(calls) == 2


def test_other_software_makes_it_anew(folder, monkeypatch):
    make, calls = counted(7)
    kept("things", b"k", make)
    monkeypatch.setattr(module, "_software", lambda: b"another")
    kept("things", b"k", make)
    assert len(calls) == 2


def test_a_folder_that_cannot_be_made_only_costs_time(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(module, "kept_folder", lambda name: tmp_path / "file" / name)
    make, calls = counted(7)
    assert kept("things", b"k", make) == kept("things", b"k", make) == 7
    assert len(calls) == 2


def test_the_oldest_entries_go(folder):
    for i in range(ENTRIES_MAX + 3):
        kept("things", b"%d" % i, lambda: 1)
    assert len(list(folder.iterdir())) == ENTRIES_MAX


def test_of_many_entries_some_go_at_a_time(folder):
    counts = []
    for i in range(70):
        kept("things", b"%d" % i, lambda: 1, 32)
        counts.append(len(list(folder.iterdir())))
    assert max(counts) == 32
    assert min(counts[32:]) == 30
    make, calls = counted(1)
    kept("things", b"69", make, 32)
    assert not calls


def test_a_kept_sky_is_the_sky(folder):
    fresh = atmosphere._sky(251, 3)
    for _ in range(2):
        atmosphere._sky_for.cache_clear()
        atmosphere._tables.cache_clear()
        again = atmosphere.sky_for(251 * atmosphere.ELEVATION_STEP_RAD, 3)
        assert again.tobytes() == fresh.tobytes()
        assert not again.flags.writeable
    assert [entry.name for entry in sorted(folder.parent.iterdir())] == ["air", "skies"]


def test_a_kept_world_is_the_world(folder):
    scene = load_scene("crossing")
    fresh = _build(scene)
    again = build_world(scene)
    assert fresh.mesh.points_m.tobytes() == again.mesh.points_m.tobytes()
    assert fresh.mesh.ambient.tobytes() == again.mesh.ambient.tobytes()
    assert fresh.colliders.tobytes() == again.colliders.tobytes()
    times = np.array([0.0, 1.3, 7.0])
    a, b = fresh.motion.at(times), again.motion.at(times)
    assert a.position_m.tobytes() == b.position_m.tobytes()
    assert (a.kind == b.kind).all()
