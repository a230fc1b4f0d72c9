"""Echo of rain at 77 GHz against Mie sums, which also give the attenuation of ITU-R P.838."""

import numpy as np
import pytest

from twin.sensors.radar.rain import attenuation_per_m, echo_per_m

WAVELENGTH_MM = 3.9
DIAMETERS_MM = np.linspace(0.05, 6.0, 240)


def water_index(ghz=76.5, celsius=10.0):
    """Refractive index of water: double Debye model (Liebe, Hufford, Manabe 1991)."""
    theta = 1.0 - 300.0 / (273.15 + celsius)
    eps_0 = 77.66 - 103.3 * theta
    eps_1, eps_2 = 0.0671 * eps_0, 3.52
    first = 20.20 + 146.4 * theta + 316.0 * theta**2
    second = 39.8 * first
    eps = (
        eps_2 + (eps_0 - eps_1) / (1 - 1j * ghz / first) + (eps_1 - eps_2) / (1 - 1j * ghz / second)
    )
    return np.sqrt(eps)


def mie(x, m):
    """Efficiencies of extinction and backscatter (Bohren and Huffman 1983, chapter 4)."""
    stop = int(x + 4.0 * x ** (1 / 3) + 2) + 2
    z = m * x
    start = int(max(stop, abs(z)) + 16)
    log_slope = np.zeros(start + 1, complex)
    for n in range(start, 0, -1):
        log_slope[n - 1] = n / z - 1.0 / (log_slope[n] + n / z)
    psi_0, psi_1 = np.cos(x), np.sin(x)
    chi_0, chi_1 = -np.sin(x), np.cos(x)
    extinction, back = 0.0, 0.0
    for n in range(1, stop):
        psi = (2 * n - 1) * psi_1 / x - psi_0
        chi = (2 * n - 1) * chi_1 / x - chi_0
        xi, xi_1 = psi - 1j * chi, psi_1 - 1j * chi_1
        slope_a, slope_b = log_slope[n] / m + n / x, m * log_slope[n] + n / x
        a = (slope_a * psi - psi_1) / (slope_a * xi - xi_1)
        b = (slope_b * psi - psi_1) / (slope_b * xi - xi_1)
        extinction += (2 * n + 1) * (a + b).real
        back += (2 * n + 1) * (-1) ** n * (a - b)
        psi_0, psi_1, chi_0, chi_1 = psi_1, psi, chi_1, chi
    return 2.0 / x**2 * extinction, abs(back) ** 2 / x**2


def rain_sums(rate_mm_per_h):
    """Echo [m^2/m^3] and attenuation [1/m] of Marshall and Palmer's drops."""
    m = water_index()
    drops = 8.0e3 * np.exp(-4.1 * rate_mm_per_h**-0.21 * DIAMETERS_MM)
    pairs = np.array([mie(np.pi * d / WAVELENGTH_MM, m) for d in DIAMETERS_MM])
    area_m2 = np.pi / 4.0 * DIAMETERS_MM**2 * 1e-6
    extinction, back = (np.trapezoid(drops * area_m2 * pairs[:, i], DIAMETERS_MM) for i in (0, 1))
    return back, extinction


@pytest.mark.parametrize("rate_mm_per_h", [1.0, 2.0, 5.0, 10.0, 25.0, 50.0])
def test_echo_is_that_of_mie_within_a_decibel(rate_mm_per_h):
    back, _ = rain_sums(rate_mm_per_h)
    assert abs(10.0 * np.log10(echo_per_m(rate_mm_per_h, 0.0) / back)) < 1.0


@pytest.mark.parametrize("rate_mm_per_h", [2.0, 10.0, 25.0])
def test_the_same_sums_attenuate_as_the_recommendation_says_within_two_decibels(rate_mm_per_h):
    _, extinction = rain_sums(rate_mm_per_h)
    ratio = extinction / attenuation_per_m(76.5e9, rate_mm_per_h, 0.0)
    assert abs(10.0 * np.log10(ratio)) < 2.0


SNOW_G_PER_CM3 = 0.1


def snow_index(density_g_per_cm3=SNOW_G_PER_CM3):
    """Refractive index of ice and air, Maxwell Garnett; ice at 77 GHz: Warren and Brandt 2008."""
    ice = (1.78 + 0.0024j) ** 2
    share = density_g_per_cm3 / 0.917 * (ice - 1) / (ice + 2)
    return np.sqrt((1 + 2 * share) / (1 - share))


def snow_sums(rate_mm_per_h):
    """Echo [m^2/m^3] and attenuation [1/m] of flakes by their melted diameters (Sekhon, Srivastava
    1970)."""
    melted_mm = np.linspace(0.05, 6.0, 160)
    flakes = 2.5e3 * rate_mm_per_h**-0.94 * np.exp(-2.29 * rate_mm_per_h**-0.45 * melted_mm)
    sizes_mm = melted_mm * SNOW_G_PER_CM3 ** (-1 / 3)
    m = snow_index()
    pairs = np.array([mie(np.pi * d / WAVELENGTH_MM, m) for d in sizes_mm])
    area_m2 = np.pi / 4.0 * sizes_mm**2 * 1e-6
    extinction, back = (np.trapezoid(flakes * area_m2 * pairs[:, i], melted_mm) for i in (0, 1))
    return back, extinction


@pytest.mark.parametrize("rate_mm_per_h", [0.25, 0.5, 1.0, 2.0, 4.4])
def test_snow_is_that_of_mie_within_half_a_decibel(rate_mm_per_h):
    back, extinction = snow_sums(rate_mm_per_h)
    ours = attenuation_per_m(76.5e9, 0.0, rate_mm_per_h)
    assert abs(10.0 * np.log10(echo_per_m(0.0, rate_mm_per_h) / back)) < 0.5
    assert abs(10.0 * np.log10(ours / extinction)) < 0.5


def test_snow_takes_away_less_than_rain_of_as_much_water_and_sends_back_far_less():
    for rate in (0.25, 1.0, 4.4):
        assert attenuation_per_m(76.5e9, 0.0, rate) < attenuation_per_m(76.5e9, rate, 0.0)
        assert echo_per_m(0.0, rate) < 0.2 * echo_per_m(rate, 0.0)
    assert attenuation_per_m(76.5e9, 0.0, 0.0) == 0.0
    assert echo_per_m(0.0, 0.0) == 0.0


def test_a_small_drop_scatters_as_rayleigh_says():
    x, m = 0.02, water_index()
    extinction, back = mie(x, m)
    polar = (m**2 - 1) / (m**2 + 2)
    assert back == pytest.approx(4.0 * x**4 * abs(polar) ** 2, rel=1e-3)
    assert extinction == pytest.approx(4.0 * x * polar.imag, rel=2e-2)
