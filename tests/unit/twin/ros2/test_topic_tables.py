"""Topic tables: the shipped ones, and mistakes in one's own."""

from __future__ import annotations

import pytest

from schemas.files.yaml_file import dump_yaml, load_yaml
from twin.base.errors import UsageError
from twin.ros2.store import type_store
from twin.ros2.tables import (
    COMMAND_TYPES,
    FOLDER,
    SOURCES,
    TOPICS_MAX,
    load_table,
    shipped_tables,
    type_of,
)


def test_shipped_tables_hold_known_types_alone():
    store = type_store()
    assert shipped_tables() == ["autoware", "nav2", "plain"]
    for name in shipped_tables():
        table = load_table(name)
        assert table.table == name
        assert all(store.knows(type_of(row)) for row in table.sensors)
        assert store.knows(table.driving().type)


def test_every_type_that_a_table_may_name_is_known():
    store = type_store()
    named = [*COMMAND_TYPES, *(each for types in SOURCES.values() for each in types)]
    assert [name for name in named if not store.knows(name)] == []


def broken(tmp_path, change):
    data = load_yaml(FOLDER / "nav2.yaml")
    change(data)
    path = tmp_path / "own.yaml"
    path.write_text(dump_yaml(data))
    return path


def drop_commands(data):
    data["commands"] = []


def twice(data):
    data["sensors"].append({"topic": "/clock", "source": "clock"})


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (lambda d: d.update(sensor=[]), "sensor"),
        (lambda d: d["sensors"][0].update(source="clok"), "sensors[0].source: given 'clok', allo"),
        (lambda d: d["sensors"][0].update(type="std_msgs/msg/String"), "sensors[0].type: given"),
        (lambda d: d["sensors"][0].update(topic="clock"), "expected a full topic name"),
        (lambda d: d["sensors"][0].update(topic="/a//b"), "expected a full topic name"),
        (lambda d: d["sensors"][0].update(layout="xyzirc"), "only rows with source lidar"),
        (lambda d: d["sensors"][0].update(qos={"depth": 0}), "sensors[0].qos.depth"),
        (lambda d: d["sensors"][0].update(source="array"), "it must hold {sensor}"),
        (lambda d: d["commands"][0].update(type="std_msgs/msg/Bool"), "commands[0].type: given"),
        (lambda d: d.update(frames={"base": "/base link"}), "frames.base: given '/base link'"),
        (drop_commands, "commands: 0 rows move the car (none); exactly one must"),
        (twice, "topic /clock stands in 2 rows"),
    ],
)
def test_mistakes_are_named_with_their_place(tmp_path, change, line):
    path = broken(tmp_path, change)
    with pytest.raises(UsageError) as caught:
        load_table(str(path))
    assert line in str(caught.value)
    assert all(each.startswith(f"{path}: ") for each in str(caught.value).split("\n"))


def test_rows_are_counted(tmp_path):
    row = {"topic": "/clock", "source": "clock"}
    path = broken(tmp_path, lambda d: d.update(sensors=[row] * (TOPICS_MAX + 1)))
    with pytest.raises(UsageError, match="200"):
        load_table(str(path))


def test_tables_that_are_not_there(tmp_path):
    with pytest.raises(UsageError, match="'autowear' given, allowed: autoware, nav2, plain, or"):
        load_table("autowear")
    with pytest.raises(UsageError, match="nowhere"):
        load_table(str(tmp_path / "nowhere.yaml"))
