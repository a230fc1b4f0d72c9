"""Counter-based random numbers in kernels: no state, nothing depends on slot or order.

The mixing function is the 64-bit finaliser of SplitMix (Steele, Lea, Flood 2014).
"""

from __future__ import annotations

import warp as wp

from twin.base.portable.quick import between, quotient

GOLDEN = wp.constant(wp.uint64(0x9E3779B97F4A7C15))
MIX_A = wp.constant(wp.uint64(0xBF58476D1CE4E5B9))
MIX_B = wp.constant(wp.uint64(0x94D049BB133111EB))
_S30, _S27, _S31 = (wp.constant(wp.uint64(n)) for n in (30, 27, 31))
_TEN_BITS = wp.constant(wp.uint64(1023))
_S10, _S20, _S40 = (wp.constant(wp.uint64(n)) for n in (10, 20, 40))

# Odd multipliers that spread the bits of a lattice cell.
_CELL_I, _CELL_J, _CELL_SEED, _CELL_A, _CELL_B = (
    wp.constant(wp.uint32(n)) for n in (0x9E3779B1, 0x85EBCA77, 0xC2B2AE3D, 0x2C1B3C6D, 0x297A2D39)
)
_R8, _R12, _R15 = (wp.constant(wp.uint32(n)) for n in (8, 12, 15))

# A sum of four uniform 10-bit integers: mean and standard deviation.
SUM_MEAN = wp.constant(2046.0)
SUM_SIGMA = wp.constant(591.20685)


@wp.func
def mix(x: wp.uint64) -> wp.uint64:
    """Scramble 64 bits."""
    a = (x ^ (x >> _S30)) * MIX_A
    b = (a ^ (a >> _S27)) * MIX_B
    return b ^ (b >> _S31)


@wp.func
def draw(key: wp.uint64, tick: wp.int32, element: wp.int32) -> wp.uint64:
    """64 random bits of a stream ``key`` at the counter (case tick, element)."""
    return mix(mix(key + GOLDEN * wp.uint64(tick + 1)) + GOLDEN * wp.uint64(element + 1))


@wp.func
def normal(bits: wp.uint64) -> wp.float32:
    """Nearly normal number, mean 0, variance 1, from 40 random bits (sum of four uniforms).

    Integer arithmetic up to one product: no device's logarithm or cosine is involved.
    """
    total = bits & _TEN_BITS
    total += (bits >> _S10) & _TEN_BITS
    total += (bits >> _S20) & _TEN_BITS
    total += (bits >> _S30) & _TEN_BITS
    return quotient(wp.float32(total) - SUM_MEAN, SUM_SIGMA)


@wp.func
def uniform(bits: wp.uint64) -> wp.float32:
    """Uniform number in [0, 1) from the upper 24 bits."""
    return wp.float32(bits >> _S40) * 5.9604645e-8


@wp.func
def lattice(i: wp.int32, j: wp.int32, seed: wp.int32) -> wp.float32:
    """Fixed random number in [0, 1) of a lattice cell, for textures."""
    h = wp.uint32(i) * _CELL_I + wp.uint32(j) * _CELL_J + wp.uint32(seed) * _CELL_SEED
    h = (h ^ (h >> _R15)) * _CELL_A
    h = (h ^ (h >> _R12)) * _CELL_B
    h = h ^ (h >> _R15)
    return wp.float32(h >> _R8) * 5.9604645e-8


@wp.func
def value_noise(x: wp.float32, y: wp.float32, seed: wp.int32) -> wp.float32:
    """Smooth random field in [0, 1), one bump per unit length."""
    i = wp.int32(wp.floor(x))
    j = wp.int32(wp.floor(y))
    u = x - wp.float32(i)
    v = y - wp.float32(j)
    u = u * u * (3.0 - 2.0 * u)
    v = v * v * (3.0 - 2.0 * v)
    low = between(lattice(i, j, seed), lattice(i + 1, j, seed), u)
    high = between(lattice(i, j + 1, seed), lattice(i + 1, j + 1, seed), u)
    return between(low, high, v)
