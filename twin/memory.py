"""``twin memory``: what a rig of so many slots takes of a GPU, without starting one."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import warp as wp

from schemas.campaign import expand, parse_campaign
from twin.fabric.errors import UsageError
from twin.sensors.rig_memory import rig_memory
from twin.vehicle.vehicle_file import load_vehicle
from twin.world.kernel_cache import prepare_kernels
from twin.world.scene import load_scene
from twin.world.street import build_world


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
    campaign, mistakes = parse_campaign(
        {
            "campaign": "memory",
            "camera": specs[0],
            "cameras": specs[1:],
            "lidars": [{"name": name} for name in lidars],
            "scenario": {"scene": scene, "vehicle": vehicle},
            "matrix": {"weather": ["clear"]},
        }
    )
    if campaign is None:
        raise UsageError("\n".join(mistake.line("twin memory") for mistake in mistakes))
    try:
        car, world = load_vehicle(vehicle), build_world(load_scene(scene))
        for name in cameras:
            car.camera(name)
        found = rig_memory(expand(campaign)[0], car, world, slots)
    except ValueError as error:
        raise UsageError(str(error)) from None
    free = _free_bytes(device)
    if as_json:
        result = {
            "slots": slots,
            "bytes": found.bytes_total,
            "rows": {row.name: row.fixed + slots * row.per_slot for row in found.rows},
            "free_bytes": free,
            "slots_max": None if free is None else found.slots_max(free),
        }
        print(json.dumps(result, indent=1))
        return
    print("\n".join(found.lines()))
    if free is not None:
        print(
            f"{free / 1e6:10,.1f} MB  are free on {device}: at most {found.slots_max(free)} slots"
        )


def _free_bytes(device: str) -> int | None:
    """Free memory of a GPU; None for the CPU."""
    known = {str(d): d for d in wp.get_devices()}
    if device not in known:
        raise UsageError(f"device '{device}': not here; allowed: {', '.join(known)}")
    found = known[device]
    return int(found.free_memory) if found.is_cuda else None
