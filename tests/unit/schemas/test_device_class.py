"""The class of devices that results depend on: the machine's, unless all that computes them is the
same everywhere."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from schemas.campaign import Campaign
from schemas.device_class import PORTABLE, is_portable, result_class
from schemas.identity import campaign_digest, case_digest, rig_key
from schemas.plan import plan_of

SAYS_SO = {"stack_identity": {"portable": True}}
TRUTH = {"perception": {"truth": {"type": "ground_truth"}}}
FLOAT = {"type": "network", "model": "yolox-tiny"}
INTEGER = {"type": "network", "model": "yolox-tiny-int8"}


def campaign(**changed: Any) -> Campaign:
    data = {"campaign": "table", "matrix": {"repeat": [0, 1]}, "autonomy": TRUTH}
    return msgspec.convert(data | SAYS_SO | changed, Campaign)


@pytest.mark.parametrize(
    ("changed", "portable"),
    [
        ({}, True),
        ({"autonomy": {"perception": {"n": INTEGER}}}, True),
        ({"autonomy": TRUTH | {"placement": "inline"}}, True),
        ({"device": "any"}, True),
        # Unless it is said, a stack's own code is not.
        ({"stack_identity": {}}, False),
        ({"stack_identity": {"portable": False}}, False),
        ({"autonomy": {"perception": {"n": FLOAT}}}, False),
        ({"autonomy": {"perception": {"i": INTEGER, "n": FLOAT}}}, False),
        ({"autonomy": {"perception": {"n": {"type": "network", "model": "/n.onnx"}}}}, False),
        ({"autonomy": TRUTH | {"command": ["./stack"]}}, False),
        ({"autonomy": TRUTH | {"placement": "node"}}, False),
        ({"plugins": {"some-sensors": "1.0"}}, False),
        ({"clock": "realtime"}, False),
    ],
)
def test_one_part_that_may_differ_makes_all_cases_of_a_campaign_the_machines(
    changed: dict[str, Any], portable: bool
) -> None:
    assert is_portable(campaign(**changed)) is portable


@pytest.mark.parametrize(
    ("machine", "proven"),
    [
        ("cpu:x86_64+avx2+fma", True),
        ("cuda:NVIDIA H200", True),
        ("cpu:x86_64+avx2+fma~opencv-5.0.1.2", True),
        ("cuda:NVIDIA H200~opencv-5.0.1.2", True),
        ("cpu:x86_64~opencv-5.0.1.2", False),
        ("cuda:NVIDIA GH200 480GB@aarch64~opencv-5.0.1.2", False),
        ("cpu:x86_64", False),
        ("cpu:aarch64", False),
        ("cuda:NVIDIA GH200 480GB@aarch64", False),
        ("cuda:", False),
        ("", False),
        ("portable\n", False),
        ("cpu:x86_64+avx2+fma\n", False),
    ],
)
def test_only_machines_whose_bytes_were_compared_mix(machine: str, proven: bool) -> None:
    assert result_class(True, machine) == (PORTABLE if proven else machine)
    assert result_class(False, machine) == machine


def test_no_digest_depends_on_it() -> None:
    """Recorded runs keep theirs, and a case is the same whatever its class is called."""
    said, unsaid = plan_of(campaign()), plan_of(campaign(stack_identity={}))
    assert [(case_digest(c), rig_key(c)) for c in said.cases] == [
        (case_digest(c), rig_key(c)) for c in unsaid.cases
    ]
    assert campaign_digest(said.campaign, said.cases) == campaign_digest(
        unsaid.campaign, unsaid.cases
    )
    assert b"portable" not in msgspec.json.encode(unsaid.campaign)
