"""A kernel per portable function, and arguments that reach every branch of it."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import warp as wp

from twin.base import portable_math

Floats = np.ndarray[Any, np.dtype[np.float64]]
OPTIONS = {"fuse_fp": False, "enable_backward": False}


def _kernel_of_one(function: Any, dtype: Any) -> Any:
    @wp.kernel(module="unique", module_options=OPTIONS)
    def evaluate(x: wp.array(dtype=dtype), out: wp.array(dtype=dtype)):
        i = wp.tid()
        out[i] = function(x[i])

    return evaluate


def _kernel_of_two(function: Any, dtype: Any) -> Any:
    @wp.kernel(module="unique", module_options=OPTIONS)
    def evaluate(x: wp.array(dtype=dtype), y: wp.array(dtype=dtype), out: wp.array(dtype=dtype)):
        i = wp.tid()
        out[i] = function(x[i], y[i])

    return evaluate


_LARGEST = 1.7976931348623157e308
SPECIAL = np.array(
    [
        *(0.0, -0.0, 1.0, -1.0, 0.5, -0.5, 2.0, -2.0, 3.0, -3.0, np.inf, -np.inf, np.nan),
        *(5e-324, -5e-324, 2.0**-1022, _LARGEST, -_LARGEST, 64.0, 65.0),
    ]
)
"""Values at which functions have rules of their own."""


def angles(random: np.random.Generator, count: int) -> Floats:
    """Angles to 1e5 rad, a third of them next to multiples of pi/4."""
    wide = random.uniform(-1e5, 1e5, count)
    near = random.integers(-127324, 127324, count) * (np.pi / 4)
    near = near * (1.0 + random.integers(-3, 4, count) * 2.0**-53)
    return np.choose(np.arange(count) % 3, [wide, near, _any_size(random, count, -60, 3)])


def _any_size(random: np.random.Generator, count: int, low: float, high: float) -> Floats:
    """Both signs, magnitudes from 2**low to 2**high in equal shares per octave."""
    return random.choice([-1.0, 1.0], count) * 2.0 ** random.uniform(low, high, count)


def ratios(random: np.random.Generator, count: int) -> Floats:
    """From -1 to 1, of all sizes and near the ends."""
    wide = random.uniform(-1.0, 1.0, count)
    ends = random.choice([-1.0, 1.0], count) * (1.0 - 2.0 ** random.uniform(-53, -1, count))
    return np.choose(np.arange(count) % 3, [wide, ends, _any_size(random, count, -60, 0)])


def exponents(random: np.random.Generator, count: int) -> Floats:
    """Every result from zero to infinity, and small arguments."""
    wide = random.uniform(-746.0, 710.0, count)
    return np.where(np.arange(count) % 2, wide, _any_size(random, count, -60, 4))


def sizes(random: np.random.Generator, count: int) -> Floats:
    """Positive numbers of all sizes, subnormal ones included, and many near 1."""
    near = 1.0 + _any_size(random, count, -52, -1)
    return np.where(np.arange(count) % 2, np.abs(_any_size(random, count, -1074, 1023)), near)


def reals(random: np.random.Generator, count: int) -> Floats:
    """Both signs, all sizes, most of them around 1."""
    return np.where(
        np.arange(count) % 4,
        _any_size(random, count, -20, 20),
        _any_size(random, count, -1074, 1023),
    )


def slopes(random: np.random.Generator, count: int) -> Floats:
    """Both signs, to 23: where the hyperbolic tangent is not flat."""
    return np.where(
        np.arange(count) % 2, random.uniform(-23.0, 23.0, count), _any_size(random, count, -60, 5)
    )


def pairs(random: np.random.Generator, count: int) -> tuple[Floats, Floats]:
    """Pairs of like and unlike sizes."""
    x = reals(random, count)
    like = x * (1.0 + _any_size(random, count, -50, 1))
    return np.where(np.arange(count) % 3, like, reals(random, count)), x


def powers(random: np.random.Generator, count: int) -> tuple[Floats, Floats]:
    """Positive bases whose power is a float, with integer and other exponents."""
    x = sizes(random, count)
    most = 740.0 / np.maximum(np.abs(np.log(x)), 1e-16)
    broken = random.uniform(-1.0, 1.0, count) * np.minimum(most, 1e15)
    whole = random.integers(-64, 65, count).astype(np.float64)
    return x, np.where(np.arange(count) % 4, broken, whole)


ONE: dict[str, Callable[[np.random.Generator, int], Floats]] = {
    "sin": angles,
    "cos": angles,
    "tan": angles,
    "asin": ratios,
    "acos": ratios,
    "atan": reals,
    "exp": exponents,
    "log": sizes,
    "tanh": slopes,
    "sin_f32": angles,
    "cos_f32": angles,
    "exp_f32": exponents,
    "log_f32": sizes,
}
"""Functions of one argument, and who draws their arguments."""

TWO: dict[str, Callable[[np.random.Generator, int], tuple[Floats, Floats]]] = {
    "atan2": pairs,
    "pow": powers,
    "hypot": pairs,
    "atan2_f32": pairs,
    "pow_f32": powers,
}
"""Functions of two arguments, and who draws their arguments."""

NAMES = (*ONE, *TWO)
COUNT = 1 << 20
"""Results of each function that are compared between devices."""
_KERNELS: dict[str, Any] = {}


def _dtype(name: str) -> Any:
    return wp.float32 if name.endswith("_f32") else wp.float64


def arguments(name: str, seed: int, count: int) -> tuple[Floats, ...]:
    """``count`` arguments per parameter of a function, special values first, as its type."""
    random = np.random.default_rng(seed)
    kind = np.float32 if name.endswith("_f32") else np.float64
    if name in ONE:
        drawn: tuple[Floats, ...] = (ONE[name](random, count),)
        special: tuple[Floats, ...] = (SPECIAL,)
    else:
        drawn = TWO[name](random, count)
        grid = np.meshgrid(SPECIAL, SPECIAL)
        special = (grid[0].ravel(), grid[1].ravel())
    with np.errstate(over="ignore", under="ignore"):
        both = zip(special, drawn, strict=True)
        return tuple(np.concatenate([rare, row])[:count].astype(kind) for rare, row in both)


def kernel_of(name: str) -> Any:
    """The kernel that evaluates a function, made once."""
    if name not in _KERNELS:
        function = getattr(portable_math, f"portable_{name}")
        make = _kernel_of_one if name in ONE else _kernel_of_two
        _KERNELS[name] = make(function, _dtype(name))
    return _KERNELS[name]


def evaluate(name: str, columns: tuple[Floats, ...], device: str) -> Floats:
    """The portable function's values on a device."""
    there = [wp.array(column, dtype=_dtype(name), device=device) for column in columns]
    out = wp.empty(len(columns[0]), dtype=_dtype(name), device=device)
    wp.launch(kernel_of(name), dim=len(columns[0]), inputs=[*there, out], device=device)
    values: Floats = out.numpy()
    return values


def rows(name: str, columns: tuple[Floats, ...], values: Floats) -> Iterator[tuple[Any, ...]]:
    """Arguments and value, row by row, as Python floats."""
    return zip(*(column.tolist() for column in columns), values.tolist(), strict=True)


def differing(device: str, count: int = COUNT) -> dict[str, int]:
    """Number of results, of ``count`` per function, whose bytes differ between CPU and device."""
    counts = {}
    for name in NAMES:
        columns = arguments(name, 11, count)
        here = evaluate(name, columns, "cpu")
        there = evaluate(name, columns, device)
        bits = np.int32 if here.dtype == np.float32 else np.int64
        counts[name] = int(np.count_nonzero(here.view(bits) != there.view(bits)))
    return counts
