"""twin.worker.options: slots by the simulator's own count. What fits on a GPU only one can say."""

from __future__ import annotations

import json
import subprocess
import sys

import msgspec
import pytest

from conductor.run.source import find
from schemas.files.yaml_file import load_yaml
from schemas.plan import expand, parse_campaign
from twin.worker.options import fitting

CASE = expand(parse_campaign(load_yaml(find("aeb-demo")))[0])[0]


def count(text: bytes, *options: str) -> subprocess.CompletedProcess:
    command = [sys.executable, "-m", "twin", "memory", "--case", "-", *options]
    return subprocess.run(command, input=text, capture_output=True)


@pytest.mark.slow
def test_the_count_of_a_case_is_a_part_of_that_of_its_campaign():
    case = count(msgspec.json.encode(CASE), "--slots", "7", "--output", "json")
    command = [sys.executable, "-m", "twin", "memory", "--campaign", str(find("aeb-demo"))]
    whole = subprocess.run([*command, "--slots", "7", "--output", "json"], capture_output=True)
    of_case, of_campaign = (json.loads(done.stdout) for done in (case, whole))
    assert of_case["rows"].items() <= of_campaign["rows"].items()
    names = [name for name in of_case["rows"] if name.startswith("network ")]
    assert names == [f"network {CASE.variation.perception.model}"]
    assert of_case["slots_max"] is None  # the CPU's memory is not counted


@pytest.mark.slow
def test_without_an_answer_all_are_taken():
    assert fitting("cpu", 7, CASE) == 7
    assert fitting("cuda:99", 7, CASE) == 7
    refused = count(b'{"id": 3}')
    assert refused.returncode == 2
    *_, line = refused.stderr.decode().splitlines()
    assert line.startswith("twin: case: Object contains unknown field `id`")
