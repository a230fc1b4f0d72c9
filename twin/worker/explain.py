"""``twin worker --explain``: how the frames of a rig here would reach its stack."""

from __future__ import annotations

from twin.fabric.frames import FrameBuffer, open_frames
from twin.fabric.software import device_class


def explanation(device: str) -> list[str]:
    """One line per way, the best first, each tried here.

    Raises:
        UsageError: no such device.
    """
    from twin.world.kernel_cache import prepare_kernels

    prepare_kernels()  # before Warp

    from twin.fabric import cuda

    kind = device_class(device)
    buffer = FrameBuffer(4096)
    mapped = open_frames(buffer.path, buffer.size, buffer.nonce) is not None
    buffer.close()
    on_gpu = cuda.offer(device) is not None
    if on_gpu:
        first = "works, for stacks that take frames there (`takes_device_frames`)"
    elif device.startswith("cuda"):
        first = "this GPU or its driver cannot share memory"
    else:
        first = f"no GPU: the worker simulates on {device}"
    ways = {
        "device": (on_gpu, first),
        "memory": (mapped, "works" if mapped else "another process cannot open the file"),
        "bytes": (True, "works; the only way for `autonomy.placement: node`"),
    }
    best = next(name for name, (works, _) in ways.items() if works)
    return [
        f"{device} is {kind}; frames travel by {best} (`placement: inline`: they do not travel)",
        *(f"{name}: {why}" for name, (_, why) in ways.items()),
    ]
