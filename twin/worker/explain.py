"""``twin worker --explain``: how the frames of a rig here would reach its stack."""

from __future__ import annotations

from twin.base.software import device_class
from twin.fabric.frames import offer_frames, open_frames
from twin.fabric.rig_folder import RigFolder, frames_socket


def explanation(device: str) -> list[str]:
    """One line per way, the best first, each tried here.

    Raises:
        UsageError: no such device.
    """
    from twin.world.kernel_cache import prepare_kernels

    prepare_kernels()  # before Warp

    from twin.base.gpu import cuda

    kind = device_class(device)
    mapped = _can_map()
    on_gpu = cuda.offer(device) is not None
    if on_gpu:
        first = "works, for stacks that take frames there (`takes_device_frames`)"
    elif device.startswith("cuda"):
        first = "this GPU or its driver cannot share memory"
    else:
        first = f"no GPU: the worker simulates on {device}"
    ways = {
        "device": (on_gpu, first),
        "memory": (
            mapped,
            "works" if mapped else "memory cannot be handed to another process",
        ),
        "bytes": (True, "works; the only way for `autonomy.placement: node`"),
    }
    best = next(name for name, (works, _) in ways.items() if works)
    return [
        f"{device} is {kind}; frames travel by {best} (`placement: inline`: they do not travel)",
        *(f"{name}: {why}" for name, (_, why) in ways.items()),
    ]


def _can_map() -> bool:
    """Whether memory can be handed to another process here."""
    folder = RigFolder()
    buffer = offer_frames(4096, frames_socket(folder.drive))
    try:
        return (
            buffer is not None and open_frames(buffer.path, buffer.size, buffer.nonce) is not None
        )
    finally:
        if buffer is not None:
            buffer.close()
        folder.close()
