"""Portable functions: error against mpmath, special values, equal bits however they are launched.

``-s`` prints the largest error of every function.
"""

import math
import re

import mpmath
import numpy as np
import portable_kernels
import pytest
import warp as wp
from portable_coefficients import constants as derived_constants

from twin.base import portable_math
from twin.base.portable import coefficients, constants
from twin.world.kernel_cache import prepare_kernels

prepare_kernels()

INF, NAN = math.inf, math.nan
PI = math.pi
COUNT = 3000
EXACT = mpmath.mp.clone()
EXACT.prec = 200
REFERENCES = {
    "sin": EXACT.sin,
    "cos": EXACT.cos,
    "tan": EXACT.tan,
    "asin": EXACT.asin,
    "acos": EXACT.acos,
    "atan": EXACT.atan,
    "exp": EXACT.exp,
    "log": EXACT.log,
    "tanh": EXACT.tanh,
    "atan2": EXACT.atan2,
    "pow": EXACT.power,
    "hypot": EXACT.hypot,
}
ULP_MAX = dict.fromkeys(REFERENCES, 1.0) | {"tan": 2.0, "tanh": 2.0, "hypot": 2.0}
F32_ULP_MAX = {"exp_f32": 1.0}
"""Those that compute in float32; others round once."""

SPECIAL = {
    "sin": [
        ((0.0,), 0.0),
        ((-0.0,), -0.0),
        ((INF,), NAN),
        ((NAN,), NAN),
        ((2.0**41,), NAN),
        ((5e-324,), 5e-324),
        ((-(2.0**-1030),), -(2.0**-1030)),
    ],
    "cos": [((0.0,), 1.0), ((-0.0,), 1.0), ((-INF,), NAN), ((NAN,), NAN), ((-(2.0**41),), NAN)],
    "tan": [((0.0,), 0.0), ((-0.0,), -0.0), ((INF,), NAN), ((5e-324,), 5e-324)],
    "asin": [
        ((1.0,), PI / 2),
        ((-1.0,), -PI / 2),
        ((-0.0,), -0.0),
        ((math.nextafter(1, 2),), NAN),
        ((NAN,), NAN),
        ((-INF,), NAN),
        ((5e-324,), 5e-324),
    ],
    "acos": [
        ((1.0,), 0.0),
        ((-1.0,), PI),
        ((0.0,), PI / 2),
        ((math.nextafter(-1, -2),), NAN),
        ((NAN,), NAN),
        ((INF,), NAN),
    ],
    "atan": [
        ((0.0,), 0.0),
        ((-0.0,), -0.0),
        ((INF,), PI / 2),
        ((-INF,), -PI / 2),
        ((NAN,), NAN),
        ((5e-324,), 5e-324),
        ((1.0,), PI / 4),
        ((-1.0,), -PI / 4),
    ],
    "exp": [
        ((0.0,), 1.0),
        ((-0.0,), 1.0),
        ((INF,), INF),
        ((-INF,), 0.0),
        ((NAN,), NAN),
        ((709.79,), INF),
        ((-745.2,), 0.0),
        ((-745.13,), 5e-324),
        ((1e308,), INF),
    ],
    "log": [
        ((0.0,), -INF),
        ((-0.0,), -INF),
        ((1.0,), 0.0),
        ((INF,), INF),
        ((-1.0,), NAN),
        ((-INF,), NAN),
        ((NAN,), NAN),
        ((5e-324,), -744.4400719213812),
    ],
    "tanh": [
        ((0.0,), 0.0),
        ((-0.0,), -0.0),
        ((INF,), 1.0),
        ((-INF,), -1.0),
        ((NAN,), NAN),
        ((5e-324,), 5e-324),
        ((400.0,), 1.0),
        ((-22.5,), -1.0),
    ],
    "atan2": [
        ((0.0, 0.0), 0.0),
        ((-0.0, 0.0), -0.0),
        ((0.0, -0.0), PI),
        ((-0.0, -0.0), -PI),
        ((0.0, -1.0), PI),
        ((-0.0, -1.0), -PI),
        ((0.0, 1.0), 0.0),
        ((-0.0, 1.0), -0.0),
        ((1.0, 0.0), PI / 2),
        ((-1.0, -0.0), -PI / 2),
        ((1.0, INF), 0.0),
        ((-1.0, INF), -0.0),
        ((1.0, -INF), PI),
        ((-1.0, -INF), -PI),
        ((INF, 1.0), PI / 2),
        ((-INF, -1.0), -PI / 2),
        ((INF, INF), PI / 4),
        ((-INF, INF), -PI / 4),
        ((INF, -INF), 3 * PI / 4),
        ((-INF, -INF), -3 * PI / 4),
        ((NAN, 1.0), NAN),
        ((1.0, NAN), NAN),
        ((0.0, NAN), NAN),
        ((5e-324, 1.0), 5e-324),
        ((5e-324, 2.0), 0.0),
        ((5e-324, -5e-324), 3 * PI / 4),
        ((2.0**-500, 2.0**450), 2.0**-950),
        ((1e308, 1e-308), PI / 2),
        ((1e-308, -1e308), PI),
    ],
    "pow": [
        ((2.0, 10.0), 1024.0),
        ((3.0, 33.0), 5559060566555523.0),
        ((10.0, 22.0), 1e22),
        ((2.0, -64.0), 2.0**-64),
        ((-3.0, 3.0), -27.0),
        ((-2.0, 2.0), 4.0),
        ((-2.0, 0.5), NAN),
        ((0.0, 2.0), 0.0),
        ((0.0, -2.0), INF),
        ((-0.0, 3.0), -0.0),
        ((-0.0, -3.0), -INF),
        ((-0.0, 2.0), 0.0),
        ((NAN, 0.0), 1.0),
        ((1.0, NAN), 1.0),
        ((2.0, NAN), NAN),
        ((NAN, 2.0), NAN),
        ((INF, 2.0), INF),
        ((-INF, 3.0), -INF),
        ((-INF, -3.0), -0.0),
        ((0.5, INF), 0.0),
        ((0.5, -INF), INF),
        ((-1.0, INF), 1.0),
        ((2.0, INF), INF),
        ((10.0, 400.0), INF),
        ((10.0, -400.0), 0.0),
        ((10.0, 64.0), 1e64),
        ((-1.0, 1e17), 1.0),
        ((5e-324, 2.0), 0.0),
        ((5e-324, -2.0), INF),
        ((5e-324, 1.0), 5e-324),
        ((4.0, 0.5), 2.0),
        ((1e300, 64.0), INF),
        ((1e300, -64.0), 0.0),
        ((1.5, -0.0), 1.0),
        ((-1.0, 65.0), -1.0),
    ],
    "hypot": [
        ((3.0, 4.0), 5.0),
        ((-3.0, 4.0), 5.0),
        ((INF, NAN), INF),
        ((NAN, -INF), INF),
        ((NAN, 1.0), NAN),
        ((0.0, -0.0), 0.0),
        ((5e-324, 0.0), 5e-324),
        ((1.2e308, 9e307), 1.5e308),
        ((3 * 2.0**-1070, 4 * 2.0**-1070), 5 * 2.0**-1070),
        ((1.7e308, 1.7e308), INF),
    ],
}


def expected(name, arguments):
    """The exact value and the nearest float; None where special rules hold."""
    if not all(map(math.isfinite, arguments)) or 0.0 in arguments:
        return None
    exact = REFERENCES[name](*map(EXACT.mpf, arguments))
    if not isinstance(exact, EXACT.mpf) or not EXACT.isfinite(exact):
        return None
    return exact, float(exact)


def errors_ulp(name, columns, values, spacing):
    """Errors in units of the last place of the nearest float, with their arguments."""
    for *arguments, value in portable_kernels.rows(name, columns, values):
        if name in ("sin", "cos", "tan") and abs(arguments[0]) > 1.6e6:
            continue
        known = expected(name.removesuffix("_f32"), arguments)
        if known is None:
            continue
        exact, nearest = known
        if math.isinf(nearest) or math.isinf(value):
            assert value == nearest, arguments
            continue
        yield float(abs(EXACT.mpf(value) - exact) / spacing(nearest)), *arguments


@pytest.mark.parametrize("name", REFERENCES)
def test_errors_are_as_small_as_documented(name):
    columns = portable_kernels.arguments(name, 7, COUNT)
    errors = list(
        errors_ulp(name, columns, portable_kernels.evaluate(name, columns, "cpu"), math.ulp)
    )
    assert len(errors) > COUNT * 0.8
    worst, *arguments = max(errors)
    print(f"{name}: {worst:.3f} ulp of {len(errors)} values, at {arguments}")
    assert worst <= ULP_MAX[name], arguments


@pytest.mark.parametrize("name", [name for name in portable_kernels.NAMES if "_f32" in name])
def test_float32_functions_round_once_or_say_so(name):
    columns = portable_kernels.arguments(name, 8, COUNT)
    values = portable_kernels.evaluate(name, columns, "cpu")

    def spacing(value):
        if abs(value) > float(np.finfo(np.float32).max):
            return math.inf
        return float(np.spacing(np.float32(abs(value))))

    finite = np.isfinite(values)
    errors = list(
        errors_ulp(name, tuple(column[finite] for column in columns), values[finite], spacing)
    )
    assert len(errors) > 500
    assert max(errors)[0] <= F32_ULP_MAX.get(name, 0.5001), max(errors)


@pytest.mark.parametrize("name", SPECIAL)
def test_special_values_have_their_bits(name):
    columns = tuple(
        np.array(column) for column in zip(*(row[0] for row in SPECIAL[name]), strict=True)
    )
    values = portable_kernels.evaluate(name, columns, "cpu")
    wanted = np.array([row[1] for row in SPECIAL[name]])
    different = values.view(np.int64) != wanted.view(np.int64)
    assert not different.any(), [
        (row, float(value))
        for row, value, wrong in zip(SPECIAL[name], values, different, strict=True)
        if wrong
    ]


@pytest.mark.parametrize("name", ["sin", "cos"])
def test_large_angles_lose_no_more_than_documented(name):
    angles = np.random.default_rng(3).uniform(1.6e6, 2.0**40, 1000)
    values = portable_kernels.evaluate(name, (angles,), "cpu")
    for angle, value in zip(angles.tolist(), values.tolist(), strict=True):
        error = abs(EXACT.mpf(value) - REFERENCES[name](EXACT.mpf(angle)))
        assert error <= angle * 2.0**-52


def test_multiples_of_a_quarter_turn_keep_their_digits():
    """The nearest floats to n * pi/2 are the hardest angles of a reduction."""
    angles = np.arange(1, 2**20, 97) * EXACT.mpf(1)
    angles = np.array([float(n * EXACT.pi / 2) for n in angles])
    for name in ("sin", "cos", "tan"):
        values = portable_kernels.evaluate(name, (angles,), "cpu")
        assert max(errors_ulp(name, (angles,), values, math.ulp))[0] <= ULP_MAX[name]


@pytest.mark.parametrize("name", portable_kernels.NAMES)
def test_bits_depend_neither_on_place_nor_on_number(name):
    columns = portable_kernels.arguments(name, 5, 5000)
    together = portable_kernels.evaluate(name, columns, "cpu")
    order = np.random.default_rng(2).permutation(5000)
    shuffled = portable_kernels.evaluate(name, tuple(c[order] for c in columns), "cpu")
    assert shuffled.tobytes() == together[order].tobytes()
    for i in range(0, 5000, 250):
        alone = portable_kernels.evaluate(name, tuple(c[i : i + 1] for c in columns), "cpu")
        assert alone.tobytes() == together[i : i + 1].tobytes()


def test_every_nan_has_the_same_bits():
    for name in portable_kernels.NAMES:
        values = portable_kernels.evaluate(name, portable_kernels.arguments(name, 1, 400), "cpu")
        bits = values.view(np.int32 if values.dtype == np.float32 else np.int64)
        assert len(set(bits[np.isnan(values)].tolist())) == 1, name


COMPILED_ALWAYS = ("sin", "pow", "hypot", "exp_f32")
"""Functions whose code for a GPU the quick lane looks at: of each sort one."""
ROUNDED = {"add", "sub", "mul", "div", "rcp", "sqrt"}
EXACT_OPERATIONS = {"abs", "cvt", "ld", "max", "min", "mov", "neg", "selp", "setp", "st"}


def float_operations(kernel, folder):
    """Operations on floats in a kernel's code for a GPU; NVRTC compiles it without one."""
    wp.compile_aot_module(kernel.module, arch=90, module_dir=str(folder), use_ptx=True)
    (code,) = [path.read_text() for path in folder.glob("*.ptx")]
    line = re.compile(r"^\s*(?:@\S+\s+)?([a-z0-9]+(?:\.[a-z0-9]+)*)\s", re.MULTILINE)
    return {name for name in line.findall(code) if re.search(r"\.f(32|64)$", name)}


@pytest.mark.parametrize(
    "name",
    [
        name if name in COMPILED_ALWAYS else pytest.param(name, marks=pytest.mark.slow)
        for name in portable_kernels.NAMES
    ],
)
def test_code_for_a_gpu_fuses_and_approximates_nothing(name, tmp_path):
    operations = float_operations(portable_kernels.kernel_of(name), tmp_path)
    rounded = {operation for operation in operations if operation.split(".")[0] in ROUNDED}
    assert rounded
    # An operation that says how it rounds is never fused afterwards.
    assert all(".rn." in operation for operation in rounded), rounded
    assert {operation.split(".")[0] for operation in operations - rounded} <= EXACT_OPERATIONS
    assert not any("approx" in operation or "ftz" in operation for operation in operations)


def test_a_fused_operation_would_be_noticed(tmp_path):
    @wp.kernel(module="unique", module_options={"fuse_fp": True, "enable_backward": False})
    def fused(x: wp.array(dtype=wp.float64), out: wp.array(dtype=wp.float64)):
        i = wp.tid()
        out[i] = portable_math.portable_sin(x[i])

    operations = float_operations(fused, tmp_path)
    assert {operation.split(".")[0] for operation in operations} & {"fma"}


def test_the_comparison_of_devices_compares():
    counts = portable_kernels.differing("cpu", 500)
    assert set(counts) == set(portable_kernels.NAMES)
    assert not any(counts.values())


def test_constants_are_the_derived_ones():
    stored = {name: value for name, value in vars(constants).items() if name.isupper()}
    assert {name: value.value for name, value in stored.items()} == derived_constants()
    plain = {name: value for name, value in vars(coefficients).items() if name.isupper()}
    assert plain == derived_constants()


def test_compiled_code_holds_every_bit_of_a_constant():
    first, second = wp.float64(constants.PI_0), wp.float64(constants.PI_1)

    @wp.kernel(module="unique", module_options=portable_kernels.OPTIONS)
    def read(out: wp.array(dtype=wp.float64)):
        out[0] = first
        out[1] = second

    out = wp.zeros(2, dtype=wp.float64, device="cpu")
    wp.launch(read, dim=1, inputs=[out], device="cpu")
    assert out.numpy().tolist() == [first.value, second.value]
