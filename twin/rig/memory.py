"""``twin memory``: what a rig of so many slots takes of a GPU, without starting one."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import warp as wp

from schemas.case import Case
from schemas.files.proposals import with_proposals
from schemas.files.yaml_file import YamlError, load_yaml, parse_yaml
from schemas.identity import rig_key
from schemas.kinds.perception import perception_kind
from schemas.plan import parse_plan
from schemas.sections.perception import Perception, file_fields
from twin.base.errors import UsageError
from twin.base.progress import bars, steps
from twin.render.memory import MemoryPlan, MemoryRow, free_bytes
from twin.scenario import families
from twin.sensors.rig_memory import rig_memory
from twin.vehicle.vehicle_file import load_vehicle
from twin.world.kernel_cache import prepare_kernels
from twin.world.street.build import build_world

_STACK_BYTES = 1_500 * 2**20
"""The stack's context, and kernels of CUDA, cuDNN and ONNX Runtime, rounded up."""
_BATCH_BYTES = 2_500 * 2**20
"""What 64 pictures of 416x416 take in YOLOv3 of full width, rounded up; others take less."""


def show_memory(
    slots: int,
    cameras: Sequence[str],
    size: tuple[int, int],
    effects: Sequence[str],
    outputs: Sequence[str],
    lidars: Sequence[str],
    scene: str,
    vehicle: str,
    device: str,
    *,
    as_json: bool,
) -> None:
    """Print the plan, and what fits if ``device`` is a GPU.

    Raises:
        UsageError: an option that cannot be used; one line each.
    """
    prepare_kernels()
    more: dict[str, Any] = {"effects": list(effects), "outputs": list(outputs)}
    specs = [{"name": name, "width": size[0], "height": size[1], **more} for name in cameras]
    data = {
        "campaign": "memory",
        "camera": specs[0],
        "cameras": specs[1:],
        "lidars": [{"name": name} for name in lidars],
        "scenario": {"scene": scene, "vehicle": vehicle},
        "matrix": {"weather": ["clear"]},
    }
    _show(_cases(data, "twin memory"), slots, _free_bytes(device), as_json=as_json)


def show_memory_of(
    campaign: str, slots: int, device: str, free_gb: float | None, *, as_json: bool
) -> None:
    """Print the memory of a campaign file's rigs, with the networks that its stack loads.

    Args:
        campaign: path of the file; ``-``: standard input.
        slots: cases at once.
        device: whose free memory is looked at, unless it is given.
        free_gb: free memory [GB]; None: what the device says.
        as_json: print JSON.

    Raises:
        UsageError: the file cannot be used; one line each.
    """
    prepare_kernels()
    try:
        if campaign == "-":
            data = parse_yaml(sys.stdin.read(), "standard input")
        else:
            path = Path(campaign)
            data = with_proposals(load_yaml(path), path.parent, campaign)
    except YamlError as error:
        raise UsageError(str(error)) from None
    free = _free_bytes(device) if free_gb is None else int(1e9 * free_gb)
    _show(_cases(data, campaign), slots, free, as_json=as_json)


def show_memory_of_case(case: bytes, slots: int, device: str, *, as_json: bool) -> None:
    """Print the memory of the rig of one case, JSON as in a lease.

    Raises:
        UsageError: it is none; one line.
    """
    prepare_kernels()
    try:
        decoded = msgspec.json.decode(case, type=Case)
    except msgspec.MsgspecError as error:
        raise UsageError(f"case: {error}") from None
    _show([decoded], slots, _free_bytes(device), as_json=as_json)


def _cases(data: Any, shown: str) -> list[Case]:
    plan, mistakes = parse_plan(data)
    if plan is None:
        raise UsageError("\n".join(mistake.line(shown) for mistake in mistakes))
    return plan.cases


def _show(cases: list[Case], slots: int, free: int | None, *, as_json: bool) -> None:
    """Print the plan of the cases' largest rig, and what fits into ``free`` [bytes]."""
    rigs = {rig_key(case): case for case in cases}
    networks = {
        msgspec.json.encode(case.variation.perception): case.variation.perception
        for case in cases
        if perception_kind(case.variation.perception).loaded
    }
    try:
        with bars():
            plans = [
                _plan(case, list(networks.values()), slots) for case in steps("rigs", rigs.values())
            ]
    except ValueError as error:
        raise UsageError(str(error)) from None
    largest = max(plans, key=lambda plan: plan.bytes_total)
    if as_json:
        result = {
            "slots": slots,
            "bytes": largest.bytes_total,
            "rows": {row.name: row.total(slots) for row in largest.rows},
            "free_bytes": free,
            "slots_max": None if free is None else largest.slots_max(free),
        }
        print(json.dumps(result, indent=1))
        return
    print("\n".join(largest.lines()))
    if free is not None:
        print(f"{free / 1e6:10,.1f} MB  are free: at most {largest.slots_max(free)} slots")


def _plan(case: Case, networks: list[Perception], slots: int) -> MemoryPlan:
    vehicle = load_vehicle(case.rig.vehicle)
    for camera in case.rig.seeing:
        vehicle.camera(camera.name)
    plan = rig_memory(case, vehicle, build_world(families.scene_of(case), case.rig.bodies), slots)
    if not networks:
        return plan
    rows = (
        MemoryRow("stack: CUDA and its libraries", _STACK_BYTES, 0),
        *(
            MemoryRow(f"network {_loaded(network)}", _network_bytes(network), 0)
            for network in networks
        ),
    )
    return replace(plan, rows=(*plan.rows, *rows))


def _loaded(variant: Perception) -> str:
    return str(getattr(variant, perception_kind(variant).loaded))


def _network_bytes(network: Perception) -> int:
    """Weights, twice because they are rearranged, and what a batch of pictures takes on the way."""
    files = [Path(name) for name in file_fields(network).values()]
    return 2 * sum(path.stat().st_size for path in files if path.is_file()) + _BATCH_BYTES


def _free_bytes(device: str) -> int | None:
    """Free memory of a GPU; None for the CPU."""
    known = {str(d): d for d in wp.get_devices()}
    if device not in known:
        raise UsageError(f"device '{device}': not here; allowed: {', '.join(known)}")
    warp_device = known[device]
    return free_bytes(warp_device) if warp_device.is_cuda else None
