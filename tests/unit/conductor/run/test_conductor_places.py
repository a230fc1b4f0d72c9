"""Where local workers compute: numbers, GPUs, cores of their own."""

import pytest

from conductor.run.places import (
    GPU_SLOTS_MAX,
    WorkerPlace,
    WorkersOption,
    cpu_slots,
    gpu_slots,
    on_cpu,
    on_gpus,
    parse_workers,
    ranges,
)
from schemas.wire.control import Share
from twin.base.errors import UsageError
from twin.base.worker_start import LocalWorker


def test_what_the_option_says():
    assert parse_workers(None) == WorkersOption()
    assert parse_workers("12") == WorkersOption(count=12)
    assert parse_workers("cuda") == WorkersOption(per_gpu=1)
    assert parse_workers("2xcuda") == WorkersOption(per_gpu=2)


@pytest.mark.parametrize("text", ["", "gpu", "-1", "1.5", "0xcuda", "2xcpu", "cuda:0", "99999"])
def test_anything_else_is_refused_in_one_line(text):
    with pytest.raises(UsageError, match="expected a number, cuda") as refused:
        parse_workers(text)
    assert "\n" not in str(refused.value)


def test_gpus_of_a_socket_share_its_cores_evenly_and_without_overlap():
    sockets = [range(8), range(8), range(8, 15)]
    places = on_gpus(["cuda:0", "cuda:1", "cuda:2"], sockets, 1)
    assert places == [
        WorkerPlace("cuda:0", (0, 1, 2, 3), Share(0, 1, 0, 3)),
        WorkerPlace("cuda:1", (4, 5, 6, 7), Share(0, 1, 1, 3)),
        WorkerPlace("cuda:2", (8, 9, 10, 11, 12, 13, 14), Share(0, 1, 2, 3)),
    ]
    twice = on_gpus(["cuda:0", "cuda:1"], [range(9), range(9)], 2)
    assert [place.device for place in twice] == ["cuda:0", "cuda:1", "cuda:0", "cuda:1"]
    assert sorted(core for place in twice for core in place.cores) == list(range(9))
    assert places[0].placed(LocalWorker()) == LocalWorker(device="cuda:0", cores="0-3")


def test_workers_of_a_gpu_have_stretches_that_all_gpus_share():
    places = on_gpus(["cuda:0", "cuda:1"], [range(16)] * 2, 2)
    assert [place.share for place in places] == [
        Share(1, 2, 0, 2),
        Share(1, 2, 1, 2),
        Share(0, 2, 0, 2),
        Share(0, 2, 1, 2),
    ]
    assert on_gpus(["cuda:0"], [range(16)], 1)[0].share is None


def test_too_few_cores_are_not_divided():
    assert on_gpus(["cuda:0", "cuda:1"], [range(3), range(3)], 1) == [
        WorkerPlace("cuda:0", (), Share(0, 1, 0, 2)),
        WorkerPlace("cuda:1", (), Share(0, 1, 1, 2)),
    ]
    assert WorkerPlace("cuda:0").placed(LocalWorker()) == LocalWorker(device="cuda:0")


def test_workers_on_the_cpu():
    assert [cpu_slots(left, 2) for left in (0, 1, 7, 8, 256)] == [1, 1, 1, 2, 2]
    assert on_cpu("cpu", 3, 2, 100, 1) == [WorkerPlace("cpu")] * 3
    assert on_cpu("cpu", 0, 2, 100, 1) == []
    assert len(on_cpu("cpu", None, 4, 100, 1)) == 4
    assert len(on_cpu("cpu", None, 64, 100, 1)) == 8
    assert len(on_cpu("cpu", None, 64, 5, 2)) == 3
    assert len(on_cpu("cpu", None, 64, 1, 16)) == 1


@pytest.mark.parametrize(
    ("left", "workers", "fit", "slots"),
    [
        (256, 1, None, 256),
        (256, 2, None, 128),
        (257, 2, 1000, 129),
        (10_000, 4, None, GPU_SLOTS_MAX),
        (256, 1, 100, 100),
        (256, 1, 0, 1),
        (1, 4, None, 1),
    ],
)
def test_slots_of_a_gpu(left, workers, fit, slots):
    assert gpu_slots(left, workers, fit) == slots


@pytest.mark.parametrize(
    ("lengths_s", "workers", "fit", "slots"),
    [
        ([10.0] * 256, 4, None, 64),  # all end together: none stands empty
        ([12.0] * 255 + [24.0], 4, None, 32),  # 171 slots, in whole batches
        ([12.0] * 255 + [24.0], 4, 20, 20),
        ([12.0] * 255 + [16.0], 4, None, 64),
        ([10.0] * 60 + [60.0], 4, None, 4),
        ([0.0] * 8, 1, None, 8),
        ([12.0] * 255 + [None], 4, None, 64),
        ([-1.0] * 8, 1, None, 8),  # a file that somebody changed
        ([1.0] * 8 + [-1e9], 1, None, 9),
    ],
)
def test_slots_that_would_stand_empty_are_not_made(lengths_s, workers, fit, slots):
    assert gpu_slots(len(lengths_s), workers, fit, lengths_s) == slots


def test_a_run_that_goes_on_has_other_cases_left_than_those_that_are_known():
    """As many lengths are known as cases are left, but not theirs."""
    known = [1.0] * 63 + [63.0] + [None] * 64
    assert gpu_slots(64, 1, None, known) == 64
    assert gpu_slots(64, 1, None, known[:64]) == 3


def test_ranges_of_cores():
    assert ranges([8, 0, 1, 2, 3]) == "0-3,8"
    assert ranges([5]) == "5"
    assert ranges([]) == ""
