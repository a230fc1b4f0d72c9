"""Tables put together from those of each program are those of all programs packed at once."""

from __future__ import annotations

import itertools
from dataclasses import fields

import numpy as np
import pytest
from msgspec.structs import replace
from train_traffic import train_traffic

from twin.base.errors import UsageError
from twin.bench.storyboard_traffic import driver_traffic, reacting_traffic
from twin.scenario.storyboard.case.files import load_storyboard
from twin.scenario.storyboard.player import joining
from twin.scenario.storyboard.player.joining import POINTERS, join_tables
from twin.scenario.storyboard.player.tables import ProgramTables, pack_programs
from twin.scenario.storyboard.program.program import StoryboardEnvironment

PROGRAMS = [
    train_traffic(6),
    reacting_traffic(4, 0),
    load_storyboard("child-behind-bus", {}).program,
    load_storyboard("oncoming-turner", {}).program,
    replace(driver_traffic(5), environments=(StoryboardEnvironment("noon", 43_200.0),)),
    load_storyboard("ncap-car-rear-braking", {}).program,
]


def assert_same(one: ProgramTables, other: ProgramTables) -> None:
    for field in fields(ProgramTables):
        mine, theirs = getattr(one, field.name), getattr(other, field.name)
        if field.name == "most":
            assert mine == theirs
        else:
            assert mine.dtype == theirs.dtype, field.name
            np.testing.assert_array_equal(mine, theirs, err_msg=field.name)


def test_programs_use_every_table_that_is_pointed_at():
    tables = pack_programs(PROGRAMS[:-1])
    for name, columns in POINTERS.items():
        for pointed in (name, *columns.values()):
            assert len(getattr(tables, pointed)), pointed


@pytest.mark.parametrize("order", [*itertools.permutations(range(6))][::143])
def test_joined_as_packed_at_once(order):
    programs = [PROGRAMS[index] for index in order]
    packed = pack_programs(programs)
    assert_same(join_tables([pack_programs([program]) for program in programs]), packed)
    assert_same(join_tables([pack_programs(programs[:2]), pack_programs(programs[2:])]), packed)


def test_parts_stay_as_they_are():
    parts = [pack_programs([program]) for program in PROGRAMS[:3]]
    join_tables(parts)
    for part, program in zip(parts, PROGRAMS, strict=False):
        assert_same(part, pack_programs([program]))


def test_more_numbers_than_fit_are_refused(monkeypatch):
    parts = [pack_programs([program]) for program in PROGRAMS[:2]]
    together = max(sum(len(p.reals) for p in parts), sum(len(p.wholes) for p in parts))
    monkeypatch.setattr(joining, "POOL_MAX", together)
    join_tables(parts)
    monkeypatch.setattr(joining, "POOL_MAX", together - 1)
    with pytest.raises(UsageError, match=f"more than {together - 1} numbers"):
        join_tables(parts)
