"""Pixels of every instance, gathered while a picture is made."""

from __future__ import annotations

import warp as wp

BOX_FIELDS = 6
"""Columns of the box accumulator: x min, y min, x max, y max, pixels, nearest distance [0.1 mm]."""

# A GPU's warp adds up its pixels of one instance first: thousands of threads that write to the same
# six numbers would wait for each other. Integers, so the order does not matter.
_GATHER = """
    int* box = boxes.data + ((size_t)slot * boxes.shape[1] + instance) * 6;
    #if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 800
    const unsigned mates = __match_any_sync(__activemask(), slot * boxes.shape[1] + instance);
    const int x0 = __reduce_min_sync(mates, column), x1 = __reduce_max_sync(mates, column);
    const int y0 = __reduce_min_sync(mates, row), y1 = __reduce_max_sync(mates, row);
    const int near = __reduce_min_sync(mates, distance);
    unsigned lane;
    asm("mov.u32 %0, %%laneid;" : "=r"(lane));
    if (lane == __ffs(mates) - 1) {
        if (x0 < box[0]) atomicMin(box, x0);
        if (y0 < box[1]) atomicMin(box + 1, y0);
        if (x1 > box[2]) atomicMax(box + 2, x1);
        if (y1 > box[3]) atomicMax(box + 3, y1);
        atomicAdd(box + 4, __popc(mates));
        if (near < box[5]) atomicMin(box + 5, near);
    }
    #elif defined(__CUDA_ARCH__)
    atomicMin(box, column);
    atomicMin(box + 1, row);
    atomicMax(box + 2, column);
    atomicMax(box + 3, row);
    atomicAdd(box + 4, 1);
    atomicMin(box + 5, distance);
    #else
    if (column < box[0]) box[0] = column;
    if (row < box[1]) box[1] = row;
    if (column > box[2]) box[2] = column;
    if (row > box[3]) box[3] = row;
    box[4] += 1;
    if (distance < box[5]) box[5] = distance;
    #endif
"""


@wp.func_native(_GATHER)
def gather_box(
    boxes: wp.array3d(dtype=wp.int32),
    slot: wp.int32,
    instance: wp.int32,
    row: wp.int32,
    column: wp.int32,
    distance: wp.int32,
):
    """Add a pixel to ``boxes[slot, instance]``; ``distance`` in tenths of a millimetre."""
