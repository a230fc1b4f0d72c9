"""The sky in kernels: the table's values, discs, clouds and drops that move with time."""

import math

import numpy as np
import pytest
import warp as wp

from twin.render.light.light import SlotLight, advance_light, begin_sky, fill_light, fill_sky
from twin.render.light.precipitation import cover
from twin.render.light.sky import SKY_COLUMNS, SKY_ROWS, sky, smooth_sky, sun_through_clouds
from twin.world.kernel_cache import prepare_kernels
from twin.world.mirror import Mirror
from twin.world.sky import sky_table
from twin.world.sky.sun import daylight
from twin.world.sky.weather import WEATHER

prepare_kernels()
wp.set_module_options({"enable_backward": False, "fuse_fp": False})
CPU = wp.get_device("cpu")
SHAPE = (SKY_ROWS, SKY_COLUMNS)


@wp.kernel
def look(
    directions: wp.array(dtype=wp.vec3),
    lights: wp.array(dtype=SlotLight),
    table: wp.array3d(dtype=wp.vec3),
    smooth_out: wp.array(dtype=wp.vec3),
    sky_out: wp.array(dtype=wp.vec3),
):
    i = wp.tid()
    smooth_out[i] = smooth_sky(directions[i], 1, lights[0], table)
    sky_out[i] = sky(directions[i], 1, lights[0], table)


@wp.kernel
def hide(lights: wp.array(dtype=SlotLight), out: wp.array2d(dtype=wp.float32)):
    i, j = wp.tid()
    rows = wp.float32(out.shape[0])
    out[i, j] = cover(
        wp.float32(j) / rows, wp.float32(i) / rows, wp.vec3(0.0, -1.0, 0.0), lights[0]
    )


@wp.kernel
def shade(lights: wp.array(dtype=SlotLight), out: wp.array(dtype=wp.float32)):
    i = wp.tid()
    out[i] = sun_through_clouds(wp.vec3(wp.float32(i) * 20.0, 0.0, 0.0), lights[0])


def lights_of(weather="clear", minute=720, key=0x123456789ABCDEF0, time_s=0.0, **options):
    lights = Mirror((1,), SlotLight, CPU)
    light = daylight(minute, WEATHER[weather], **options)
    row = lights.host[0]
    fill_light(row, light, WEATHER[weather])
    row["key"] = key
    begin_sky(row, key)
    advance_light(row, time_s)
    table = Mirror((2, *SHAPE), wp.vec3, CPU)
    table.host[0] = np.nan  # another slot's sky
    fill_sky(table.host[1], light)
    return lights, table, light


def seen(directions, lights, table):
    d = wp.array(np.asarray(directions, np.float32), dtype=wp.vec3, device=CPU)
    out = [wp.zeros(len(d), dtype=wp.vec3, device=CPU) for _ in range(2)]
    wp.launch(look, len(d), inputs=[d, lights.device, table.device], outputs=out, device=CPU)
    return out[0].numpy(), out[1].numpy()


def test_the_tables_entries_are_found_where_they_stand():
    lights, table, light = lights_of(minute=600)
    flat = np.sqrt(1 - sky_table.SINE**2)
    directions = [
        (flat[i] * x, flat[i] * y, sky_table.SINE[i])
        for i in range(SKY_ROWS - 1)
        for x, y in sky_table.HEADING
    ]
    smooth, _ = seen(directions, lights, table)
    expected = light.sky[:-1].reshape(-1, 3)
    np.testing.assert_allclose(smooth, expected, rtol=2e-3)


def test_the_sky_is_continuous_all_around_and_over_the_zenith():
    lights, table, _ = lights_of(minute=450)
    turn = np.linspace(0, 2 * math.pi, 2000)
    for up in (-0.3, 0.0, 0.02, 0.5, 0.999):
        flat = math.sqrt(1 - up * up)
        ring = np.stack([flat * np.cos(turn), flat * np.sin(turn), np.full(2000, up)], axis=1)
        smooth, _ = seen(ring, lights, table)
        assert np.isfinite(smooth).all()
        steps = np.abs(np.diff(smooth, axis=0))
        assert steps.max() < 0.04 * smooth.max()
    tilt = np.linspace(-0.5, math.pi + 0.5, 4000)
    arc = np.stack([np.cos(tilt), np.zeros(4000), np.sin(tilt)], axis=1)
    smooth, _ = seen(arc, lights, table)
    assert np.abs(np.diff(smooth, axis=0)).max() < 0.05 * smooth.max()


def disc(body, lights, table):
    """Directions over 1 deg around a body, [N, N, 3], and what the sky shows there."""
    side = np.cross(body, (0, 0, 1.0))
    side /= np.linalg.norm(side)
    top = np.cross(side, body)
    offset = np.radians(np.linspace(-0.5, 0.5, 101))
    grid = body + offset[None, :, None] * side + offset[:, None, None] * top
    grid /= np.linalg.norm(grid, axis=2, keepdims=True)
    smooth, full = seen(grid.reshape(-1, 3), lights, table)
    return (full - smooth).reshape(101, 101, 3)


def test_the_sun_has_its_size_and_a_darker_limb():
    lights, table, light = lights_of(minute=720, key=0)
    lights.host[0]["cloud_cover"] = 0.0
    bright = disc(light.sun_direction, lights, table)[..., 1]
    inside = bright > 0.2 * bright.max()
    assert math.sqrt(inside.sum() / math.pi) / 100 == pytest.approx(0.2666, abs=0.01)
    assert bright[50, 50] > 1.3 * bright[50, 50 + 24]
    hidden, table, light = lights_of("cloudy", minute=720)
    assert disc(light.sun_direction, hidden, table).max() < 0.01 * bright.max()


@pytest.mark.parametrize(("date", "share"), [("2025-03-14", 1.0), ("2025-03-07", 0.55)])
def test_the_moon_shows_its_phase(date, share):
    # Full on the 14th; a day after the first quarter on the 7th.
    minute = 60 if share == 1.0 else 1260
    lights, table, light = lights_of(minute=minute, date=date)
    lights.host[0]["cloud_cover"] = 0.0
    bright = disc(light.moon_direction, lights, table)[..., 1]
    lit = (bright > 0.5 * bright.max()).sum() / (math.pi * 26.66**2)
    assert lit == pytest.approx(share, abs=0.09)


def test_clouds_drift_with_time_and_differ_by_case():
    directions = np.random.default_rng(1).normal(size=(500, 3))
    directions[:, 2] = np.abs(directions[:, 2]) + 0.2
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    now = seen(directions, *lights_of(time_s=0.0)[:2])
    same = seen(directions, *lights_of(time_s=0.0)[:2])
    later = seen(directions, *lights_of(time_s=30.0)[:2])
    other = seen(directions, *lights_of(key=99 << 40)[:2])
    assert now[1].tobytes() == same[1].tobytes()
    assert now[0].tobytes() == later[0].tobytes()
    for changed in (later, other):
        assert (np.abs(changed[1] - now[1]).max(axis=1) > 1.0).mean() > 0.1


def test_advancing_many_rows_equals_advancing_each():
    one, many = Mirror((3,), SlotLight, CPU), Mirror((3,), SlotLight, CPU)
    light = daylight(600, WEATHER["cloudy"])
    for slot in range(3):
        for rows in (one.host, many.host):
            fill_light(rows[slot], light, WEATHER["cloudy"], (0.6, 0.8))
            rows[slot]["key"] = 1 << (20 + 7 * slot)
    times = np.array([0.0, 1.5, 40.0])
    advance_light(many.host, times)
    for slot in range(3):
        advance_light(one.host[slot], times[slot])
    assert one.host.tobytes() == many.host.tobytes()


def test_clouds_shade_the_sun_by_their_cover():
    shares = []
    for weather, cloud in (("clear", 0.0), ("clear", 0.5), ("cloudy", 1.0)):
        lights, _, _ = lights_of(weather)
        lights.host[0]["cloud_cover"] = cloud
        out = wp.zeros(4000, dtype=wp.float32, device=CPU)
        wp.launch(shade, 4000, inputs=[lights.device], outputs=[out], device=CPU)
        values = out.numpy()
        assert values.min() >= 0.25
        assert values.max() <= 1.0
        shares.append(values.mean())
    assert shares[0] > 0.9 > shares[1] > shares[2]
    assert shares[2] < 0.4


def picture(weather, time_s, key=7, shape=(180, 320)):
    lights, _, _ = lights_of(weather, key=key, time_s=time_s)
    lights.host[0]["slant"] = 0.0
    out = wp.zeros(shape, dtype=wp.float32, device=CPU)
    wp.launch(hide, shape, inputs=[lights.device], outputs=[out], device=CPU)
    return out.numpy()


@pytest.mark.parametrize(("weather", "step_s"), [("heavy_rain", 0.002), ("heavy_snow", 0.01)])
def test_drops_and_flakes_fall_from_frame_to_frame(weather, step_s):
    first, second = picture(weather, 5.0), picture(weather, 5.0 + step_s)
    assert first.tobytes() == picture(weather, 5.0).tobytes()
    assert (first != second).any()

    def match(shift):
        a, b = first[: 180 - shift], second[shift:]
        return np.corrcoef(a.ravel(), b.ravel())[0, 1]

    downwards = [match(shift) for shift in range(8)]
    upwards = np.corrcoef(first[4:].ravel(), second[:-4].ravel())[0, 1]
    assert max(downwards) > 0.35  # the same drops, further down
    assert max(downwards) > upwards + 0.1
    assert (picture(weather, 5.0, key=8) != first).any()


def test_more_rain_and_snow_hide_more():
    shares = {w: picture(w, 3.0, shape=(360, 640)).mean() for w in WEATHER}
    assert shares["clear"] == shares["heavy_fog"] == 0.0
    assert 0.0005 < shares["light_rain"] < 0.6 * shares["heavy_rain"] < 0.1
    assert 0.005 < shares["light_snow"] < 0.6 * shares["heavy_snow"] < 0.3


@wp.kernel
def hide_towards(lights: wp.array(dtype=SlotLight), right: wp.vec3, out: wp.array2d(dtype=float)):
    i, j = wp.tid()
    rows = wp.float32(out.shape[0])
    out[i, j] = cover(wp.float32(j) / rows, wp.float32(i) / rows, right, lights[0])


def test_rain_slants_with_the_wind_as_each_camera_sees_it():
    lights, _, _ = lights_of("heavy_rain")
    lights.host[0]["slant"] = (0.0, 0.5)  # to the left of who looks along the street

    def seen(right):
        out = wp.zeros((180, 320), dtype=wp.float32, device=CPU)
        wp.launch(
            hide_towards, (180, 320), inputs=[lights.device, right], outputs=[out], device=CPU
        )
        return out.numpy()

    def lean(image):
        """Columns by which streaks move per row downwards."""
        shifts = range(-6, 7)
        match = [
            np.corrcoef(image[:-8].ravel(), np.roll(image, -s, 1)[8:].ravel())[0, 1] for s in shifts
        ]
        return shifts[int(np.argmax(match))]

    assert lean(seen(wp.vec3(0.0, -1.0, 0.0))) < -1
    assert lean(seen(wp.vec3(0.0, 1.0, 0.0))) > 1
    assert lean(seen(wp.vec3(1.0, 0.0, 0.0))) == 0
