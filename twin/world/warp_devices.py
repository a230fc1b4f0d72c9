"""``python -m twin.world.warp_devices``: what Warp's CUDA is here, as JSON, for `conductor doctor`.

A process of its own, because a broken driver may end the one that starts it.
"""

from __future__ import annotations

import json

import warp as wp

from twin.world.kernel_cache import prepare_kernels


def main() -> None:
    """Entry point."""
    prepare_kernels()
    devices = [device.name for device in wp.get_cuda_devices()]
    toolkit = ".".join(map(str, wp.get_cuda_toolkit_version()))
    driver = ".".join(map(str, wp.get_cuda_driver_version())) if devices else ""
    found = {"toolkit": toolkit, "driver": driver, "devices": devices}
    print(json.dumps(found))


if __name__ == "__main__":
    main()
