"""Wheels of a vehicle side by side: on a GPU four lanes of a warp have one each, a CPU takes all.

Lanes compute the body four times over, from the same numbers by the same operations. What a wheel
adds to the body is summed by all of them in the order of the wheels, so that sums have the same
bits as on a CPU.
"""

from __future__ import annotations

import warp as wp

LANES = 4
"""Threads of a vehicle on a GPU, side by side in a warp: a block has a multiple of it, and at most
a warp."""


PART = (
    *("up_x", "up_y", "up_z"),
    *("force_x", "force_y", "lift"),
    *("moment_x", "moment_y", "moment_z", "back_x", "back_y", "back_z"),
    *("force_z", "pressure", "spin", "angle", "load", "slip", "sideslip"),
)
"""What a wheel gives: normal of the ground (world axes), force along the road and lift of the
suspension [N], moments on the body and what is taken from them [N m] (vehicle axes); then its own
values, the first of which moves the wheel along the body's z axis [N]."""

_VALUES = PART[12:]
UP, FORCE, LIFT, TORQUE, VALUES = 0, 3, 6, 7, 10
"""Where sums begin in a :data:`wheel_sum`; behind them stand the four wheels' values, by name."""

wheel_part = wp.types.vector(length=len(PART), dtype=wp.float64)
wheel_sum = wp.types.vector(length=VALUES + 4 * len(_VALUES), dtype=wp.float64)

_FIRST = wp.constant(VALUES)
_MASK = "const unsigned mask = 0xFu << (threadIdx.x & 28u);"


def _added(row: str, wheel: str) -> str:
    """C++ that adds what a wheel gives; ``row``: where it stands."""

    def part(name: str) -> str:
        return f"{row}[{PART.index(name)}]"

    terms = [(UP + i, part(f"up_{axis}")) for i, axis in enumerate("xyz")]
    terms += [(FORCE, part("force_x")), (FORCE + 1, part("force_y")), (FORCE + 2, "0.0")]
    terms += [(LIFT, part("lift"))]
    lines = [f"total[{k}] = total[{k}] + {term};" for k, term in terms]
    for k, axis in enumerate("xyz", TORQUE):
        more, less = part(f"moment_{axis}"), part(f"back_{axis}")
        lines.append(f"total[{k}] = (total[{k}] + {more}) - {less};")
    for k, name in enumerate(_VALUES):
        lines.append(f"total[{VALUES + 4 * k} + {wheel}] = {part(name)};")
    return "\n".join(lines)


BOARD = "\n".join(_added(f"board[{wheel}]", str(wheel)) for wheel in range(4))
"""Statements that add the parts of four wheels, one after another, from a board in shared memory.
With it there is one barrier: shuffles of lanes whose number the compiler does not know take one
each."""
_ADD = f"""
#if defined(__CUDA_ARCH__)
    __shared__ double boards[32][{len(PART)}];
    {_MASK}
    #pragma unroll
    for (int k = 0; k < {len(PART)}; ++k)
        boards[threadIdx.x & 31u][k] = part[k];
    __syncwarp(mask);
    const double (*board)[{len(PART)}] = boards + (threadIdx.x & 28u);
    {BOARD}
#else
    {_added("part", "wheel")}
#endif
    return total;
"""

_OF = """
#if defined(__CUDA_ARCH__)
    // Choices, because an index that is not known would take the values to memory.
    const double front = wheel & 1 ? values[1] : values[0];
    const double rear = wheel & 1 ? values[3] : values[2];
    return wheel & 2 ? rear : front;
#else
    return values[wheel];
#endif
"""

_TOGETHER = f"""
#if defined(__CUDA_ARCH__)
    {_MASK}
    __syncwarp(mask);
#endif
"""


@wp.func_native(_ADD)
def add_wheel(total: wheel_sum, part: wheel_part, wheel: wp.int32) -> wheel_sum:
    """``total`` and what ``wheel`` gives.

    On a GPU the four lanes give theirs at once, and all are added in the order of the wheels. Lanes
    must come :func:`together` before they add again.
    """


@wp.func_native(_OF)
def of(values: wp.vec4d, wheel: wp.int32) -> wp.float64:
    """The value of ``wheel``."""


@wp.func
def three(total: wheel_sum, at: wp.int32) -> wp.vec3d:
    """A vector of sums."""
    return wp.vec3d(total[at], total[at + 1], total[at + 2])


@wp.func
def four(total: wheel_sum, value: wp.int32) -> wp.vec4d:
    """A value of all wheels, counted from the first."""
    at = _FIRST + 4 * value
    return wp.vec4d(total[at], total[at + 1], total[at + 2], total[at + 3])


@wp.func_native(_TOGETHER)
def together():
    """Wait for the vehicle's other lanes, and see what they wrote."""
