"""A job request says in one line what is wrong with it."""

import pytest

from hpc.request import JobRequest, hours_minutes, parse_walltime
from twin.base.errors import UsageError


def request(**changes):
    """A good request with changes."""
    values = {
        "campaign": "aeb-demo",
        "out": "/project/runs/aeb-demo",
        "folder": "/work",
        "bin_folder": "/project/venv/bin",
        "walltime_min": 60,
        "workers": 2,
        **changes,
    }
    return JobRequest(**values)


@pytest.mark.parametrize(
    "changes",
    [
        {"workers": 1},
        {"workers": 4096},
        {"workers": 0, "gpus": 1},
        {"workers": 0, "gpus": 4096},
        {"nodes": 1},
        {"nodes": 2},
        {"slots": 4096},
        {"cpus_per_worker": 1},
        {"cpus_per_worker": 1024},
        {"walltime_min": 3},
        {"walltime_min": 2, "signal_lead_s": 30},
        {"walltime_min": 366 * 24 * 60},
        {"walltime_min": 62, "signal_lead_s": 3600},
        {"restarts_max": 0},
        {"partition": "gpu,gpu-long", "account": "proj@gpu"},
        {"address": "10.1.2.3"},
        {"address": "node-1.ib.example"},
        {"address": "[fd00::1]"},
        {"out": "/a folder/with 'quotes' \"and\" $(more)"},
    ],
)
def test_what_is_allowed_is_taken_as_given(changes):
    made = request(**changes)
    assert {name: getattr(made, name) for name in changes} == changes


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"workers": 0}, "give --gpus N"),
        ({"gpus": 1}, "every GPU has one worker"),
        ({"workers": -1}, "0 to 4096"),
        ({"workers": 4097}, "0 to 4096"),
        ({"workers": 0, "gpus": 4097}, "0 to 4096"),
        ({"nodes": 0}, "1 to 2"),
        ({"nodes": 3}, "every node needs a task"),
        ({"slots": 0}, "1 to 4096"),
        ({"slots": 4097}, "1 to 4096"),
        ({"cpus_per_worker": 0}, "1 to 1024"),
        ({"cpus_per_worker": 1025}, "1 to 1024"),
        ({"walltime_min": 2}, "00:03 to 8784:00"),
        ({"walltime_min": 366 * 24 * 60 + 1}, "00:03 to 8784:00"),
        ({"walltime_min": 61, "signal_lead_s": 3600}, "01:02 to"),
        ({"signal_lead_s": 29}, "30 to 3600 s"),
        ({"signal_lead_s": 3601}, "30 to 3600 s"),
        ({"restarts_max": -1}, "0 to 1000"),
        ({"restarts_max": 1001}, "0 to 1000"),
        ({"partition": "a b"}, "--partition"),
        ({"partition": "a\n#SBATCH --wrap=x"}, "--partition"),
        ({"account": "-x"}, "--account"),
        ({"account": "$(id)"}, "--account"),
        ({"account": "x\n"}, "--account"),
        ({"address": "10.1.2.3:7447"}, "without a port"),
        ({"address": "a b"}, "without a port"),
        ({"address": "10.1.2.3\n"}, "without a port"),
        ({"out": "runs/x"}, "absolute"),
        ({"folder": "."}, "absolute"),
        ({"bin_folder": ""}, "absolute"),
        ({"out": "/a\nb"}, "line break"),
        ({"campaign": "a\x00b"}, "line break"),
        ({"campaign": ""}, "shipped name"),
        ({"campaign": "--help"}, "shipped name"),
    ],
)
def test_bad(changes, said):
    with pytest.raises(UsageError) as caught:
        request(**changes)
    assert said in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_workers_and_cpus():
    assert (request().tasks, request().cpus) == (2, 1)
    on_gpus = request(workers=0, gpus=3)
    assert (on_gpus.tasks, on_gpus.cpus) == (3, 4)
    assert request(cpus_per_worker=7).cpus == 7


def test_one_node():
    assert request(nodes=1).one_node
    assert request(workers=1).one_node
    assert not request().one_node
    assert not request(nodes=2).one_node


@pytest.mark.parametrize(("text", "minutes"), [("00:05", 5), ("1:00", 60), ("72:30", 4350)])
def test_walltime(text, minutes):
    assert parse_walltime(text) == minutes
    assert parse_walltime(hours_minutes(minutes)) == minutes


@pytest.mark.parametrize(
    "text", ["", "10", "1:60", "01:00:00", "1-00:00", "-1:00", "1:5", "1:00\n"]
)
def test_bad_walltime(text):
    with pytest.raises(UsageError, match="expected HH:MM"):
        parse_walltime(text)


@pytest.mark.parametrize(
    ("changes", "one_node"),
    [
        ({"workers": 1}, True),
        ({"workers": 2}, False),
        ({"workers": 2, "nodes": 1}, True),
        ({"workers": 1, "remote_stacks": True}, False),
    ],
)
def test_only_a_single_task_is_on_one_node_for_certain(changes, one_node):
    assert request(**changes).one_node is one_node
