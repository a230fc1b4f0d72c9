"""Post-processing against NumPy, and against what each effect is."""

from __future__ import annotations

import math

import numpy as np
import post_references as reference
import pytest
import warp as wp

from schemas.sections.lens import EFFECTS, Lens
from twin.bench.post import measure
from twin.render.light.light import SlotLight
from twin.render.post import bloom as post_bloom
from twin.render.post.chain import PostEffects, bytes_needed, effective
from twin.render.post.film import falloff
from twin.render.post.focus import FocusBlur, focus_of
from twin.render.post.motion import MotionBlur
from twin.render.tone import tone_table
from twin.world.kernel_cache import prepare_kernels
from twin.world.mirror import Mirror

prepare_kernels()
CPU = wp.get_device("cpu")
HEIGHT, WIDTH = 96, 160
# A long lens on a large sensor, so that out of focus is really out of focus.
PORTRAIT = Lens(fx=2.0, sensor_width_mm=100.0, f_number=2.0, focus_m=8.0)


def halves(values: np.ndarray) -> wp.array:
    return wp.array(np.asarray(values, np.float16), dtype=wp.float16, device=CPU)


def floats(values: np.ndarray) -> wp.array:
    return wp.array(np.asarray(values, np.float32), dtype=wp.float32, device=CPU)


def lights(slots: int = 1, noise: bool = False, tick: int = 3) -> Mirror:
    mirror = Mirror((slots,), SlotLight, CPU)
    mirror.host["active"], mirror.host["noise"], mirror.host["tick"] = 1, int(noise), tick
    mirror.host["key"] = 1000 + np.arange(slots)
    return mirror


def scene(seed: int = 1, slots: int = 1) -> np.ndarray:
    """Linear pixels [S, H, W, 3] with a few lamps, as 16-bit floats hold them."""
    rng = np.random.default_rng(seed)
    blocks = rng.uniform(0.02, 1.5, (slots, HEIGHT // 8, WIDTH // 8, 3))
    image = blocks.repeat(8, axis=1).repeat(8, axis=2)
    image[:, 20, 30] = 50.0
    return image.astype(np.float16)


def depths(seed: int = 2, slots: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    depth = rng.choice([2.0, 5.0, 8.0, 30.0, np.inf], (slots, HEIGHT // 16, WIDTH // 16))
    return depth.repeat(16, axis=1).repeat(16, axis=2).astype(np.float32)


def flows(slots: int = 1) -> np.ndarray:
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    flow = np.stack([(columns - WIDTH / 2) * 0.2, (rows - HEIGHT / 2) * 0.2], axis=-1)
    return np.broadcast_to(flow, (slots, HEIGHT, WIDTH, 2)).astype(np.float32)


def run(effects, lens=PORTRAIT, image=None, depth=None, flow=None, light=None, gain=None):
    """The 8-bit images [S, H, W, 3]."""
    image = scene() if image is None else image
    slots, height, width, _ = image.shape
    post = PostEffects(effects, lens, slots, height, width, CPU)
    if gain is not None:
        post.gain.assign(np.asarray(gain, np.float32))
    out = wp.zeros((slots, height, width, 3), dtype=wp.uint8, device=CPU)
    post.apply(
        halves(image),
        floats(depths(slots=slots) if depth is None else depth),
        floats(flows(slots) if flow is None else flow),
        (light or lights(slots)).device,
        wp.array(tone_table(), dtype=wp.uint8, device=CPU),
        out,
    )
    return out.numpy()


def close(found: np.ndarray, expected: np.ndarray, share: float = 1.0, within: int = 1) -> None:
    """8-bit values differ by no more than ``within`` on ``share`` of the pixels."""
    off = np.abs(found.astype(int) - expected.astype(int)) <= within
    assert off.mean() >= share, f"{(~off).mean():.2%} differ"


def test_without_effects_only_the_tone_is_left():
    np.testing.assert_array_equal(run([]), reference.tone(scene().astype(np.float32)))
    twice = run([], gain=[2.0])
    np.testing.assert_array_equal(twice, reference.tone(2.0 * scene().astype(np.float32)))


def test_an_effect_without_amount_is_the_identity():
    still = Lens(bloom=0, chromatic_aberration=0, vignette=0, grain=0, shutter_s=0)
    assert effective(EFFECTS, still) == ("depth_of_field",)
    plain = run([])
    for effect in EFFECTS[1:]:
        np.testing.assert_array_equal(run([effect], still), plain)
    in_focus = np.full((1, HEIGHT, WIDTH), 8.0)
    np.testing.assert_array_equal(run(["depth_of_field"], depth=in_focus), plain)
    nothing_moves = np.zeros((1, HEIGHT, WIDTH, 2))
    np.testing.assert_array_equal(run(["motion_blur"], flow=nothing_moves), plain)


def test_focus_is_that_of_the_reference():
    image, depth = scene(), depths()
    lens = focus_of(PORTRAIT, HEIGHT, WIDTH, 70.0)
    out = halves(np.zeros_like(image))
    blur = FocusBlur(lens, 1, HEIGHT, WIDTH, CPU)
    blur.blur(lights().device, halves(image), floats(depth), out)
    expected = reference.focus(image[0].astype(np.float64), depth[0], lens)
    off = np.abs(out.numpy()[0].astype(float) - expected) > 2e-3 * np.maximum(expected, 1.0)
    # A sample exactly between two pixels may fall to either.
    assert off.any(axis=-1).mean() < 2e-3
    assert (np.abs(expected - image[0].astype(float)).max(axis=-1) > 0.01).mean() > 0.2


def test_pixels_without_depth_are_far():
    depth = depths()
    assert np.isinf(depth).any()
    none = np.where(np.isinf(depth), 0.0, depth)
    expected = run(["depth_of_field"], depth=depth)
    np.testing.assert_array_equal(run(["depth_of_field"], depth=none), expected)


def blurred_edge(left_m: float, right_m: float) -> np.ndarray:
    """Mean row of a picture, dark on the left and bright on the right, at two distances."""
    image = np.full((1, 180, 320, 3), 0.1, np.float16)
    image[:, :, 160:] = 1.1
    depth = np.full((1, 180, 320), left_m, np.float32)
    depth[:, :, 160:] = right_m
    out = halves(np.zeros_like(image))
    blur = FocusBlur(focus_of(PORTRAIT, 180, 320, 70.0), 1, 180, 320, CPU)
    blur.blur(lights().device, halves(image), floats(depth), out)
    return out.numpy()[0].astype(float)[20:-20].mean(axis=(0, 2)) - 0.1


@pytest.mark.parametrize("distance_m", [4.5, 6.0, 16.0, 40.0])
def test_blur_has_the_radius_of_the_thin_lens(distance_m):
    focal_m, focus_m = 0.2, 8.0
    aperture_m = focal_m / 2.0
    diameter_m = aperture_m * focal_m / (focus_m - focal_m) * abs(distance_m - focus_m) / distance_m
    radius_px = 0.5 * diameter_m / 0.1 * 320
    assert 0.5 < radius_px < 8.0  # what is drawn
    spread = np.diff(blurred_edge(distance_m, distance_m))
    columns = np.arange(len(spread)) - 159.0
    assert spread.sum() == pytest.approx(1.0, abs=2e-3)
    assert (spread * columns).sum() == pytest.approx(0.0, abs=0.1)
    # The line spread of a disc of radius r has the standard deviation r / 2.
    assert math.sqrt((spread * columns**2).sum()) == pytest.approx(radius_px / 2, rel=0.15, abs=0.3)


def test_what_is_sharp_does_not_leak_and_what_is_near_spreads():
    sharp_before_far = blurred_edge(40.0, 8.0)
    np.testing.assert_allclose(sharp_before_far[:160], 0.0, atol=1e-3)
    np.testing.assert_allclose(sharp_before_far[160:], 1.0, atol=2e-3)
    far_beside_sharp = blurred_edge(8.0, 40.0)
    np.testing.assert_allclose(far_beside_sharp[:160], 0.0, atol=1e-3)
    # Before the focus the edge becomes the share of a disc that a half-plane covers.
    near_before_sharp = blurred_edge(8.0, 4.0)
    radius_px = 0.5 * 0.1 * 0.2 / 7.8 * 4.0 / 4.0 / 0.1 * 320
    h = np.clip((np.arange(320) - 159.5) / radius_px, -1.0, 1.0)
    covered = 0.5 + (np.arcsin(h) + h * np.sqrt(1.0 - h * h)) / math.pi
    np.testing.assert_allclose(near_before_sharp, covered, atol=0.06)


def test_motion_is_that_of_the_reference():
    image, flow, depth = scene(), flows(), depths()
    flow[0, 30:60, 50:90] = (14.0, -6.0)  # something fast before and behind others
    blur = MotionBlur(0.5, 1, HEIGHT, WIDTH, CPU)
    out = halves(np.zeros_like(image))
    blur.blur(lights().device, halves(image), floats(flow), floats(depth), out)
    expected = reference.motion(image[0].astype(float), flow[0], depth[0], blur._shutter)
    off = np.abs(out.numpy()[0] - expected) > 1e-3 * np.maximum(expected, 1.0)
    # Taps between two pixels, and objects at the limit of their reach, may fall to either side.
    assert off.any(axis=-1).mean() < 5e-3
    assert (np.abs(expected - image[0].astype(float)).max(axis=-1) > 0.01).mean() > 0.2


def moving_block(depth_left_m=10.0):
    """Mean row of a bright block of 40 columns that moves 32 px while the shutter is open."""
    image = np.full((1, 48, 320, 3), 0.1, np.float16)
    flow = np.zeros((1, 48, 320, 2))
    depth = np.full((1, 48, 320), 20.0)
    depth[:, :, :140] = depth_left_m
    image[:, :, 140:180], flow[:, :, 140:180, 0], depth[:, :, 140:180] = 1.1, 64.0, 10.0
    out = halves(np.zeros_like(image))
    blur = MotionBlur(0.5, 1, 48, 320, CPU)
    blur.blur(lights().device, halves(image), floats(flow), floats(depth), out)
    return out.numpy()[0].astype(float).mean(axis=(0, 2)) - 0.1


def test_a_moving_object_passes_over_its_surroundings():
    columns = np.arange(320) + 0.5
    # A box of 40 px, averaged over a way of 32 px.
    ramp = np.clip((columns - 140.0) / 32.0 + 0.5, 0.0, 1.0)
    fall = np.clip((180.0 - columns) / 32.0 + 0.5, 0.0, 1.0)
    profile = moving_block()
    np.testing.assert_allclose(profile, np.minimum(ramp, fall), atol=0.13)
    assert profile.sum() == pytest.approx(40.0, rel=0.03)
    behind = moving_block(depth_left_m=5.0)
    np.testing.assert_allclose(behind[:140], 0.0, atol=1e-3)
    np.testing.assert_array_equal(behind[140:], profile[140:])


@pytest.mark.parametrize(("speed_px", "shutter_s"), [(16.0, 0.05), (32.0, 0.0125), (24.0, 0.02)])
def test_blur_is_as_long_as_the_shutter_is_open(speed_px, shutter_s):
    image = np.zeros((1, 32, 320, 3), np.float16)
    image[:, :, 160] = 8.0
    flow = np.zeros((1, 32, 320, 2))
    flow[..., 0] = speed_px
    depth = np.ones((1, 32, 320))
    found = run(["motion_blur"], Lens(shutter_s=shutter_s), image, depth, flow)[0, 16, :, 0]
    lit = np.flatnonzero(found)
    length = speed_px * shutter_s * 20
    assert lit[-1] - lit[0] + 1 == pytest.approx(length * 7 / 8 + 1, abs=1.0)
    assert lit.mean() == pytest.approx(160, abs=0.5)  # the frame's time is the middle
    assert reference.signal_of(found).sum() == pytest.approx(8.0, rel=0.02)


def test_bloom_is_that_of_the_reference_and_keeps_the_light():
    image = scene()
    bloom = post_bloom.Bloom(1, HEIGHT, WIDTH, CPU)
    found = bloom.spread(lights().device, halves(image)).numpy()[0].astype(float)
    sizes = post_bloom.level_sizes(HEIGHT, WIDTH)
    assert sizes == [(48, 80), (24, 40), (12, 20)]
    expected = reference.scattered(image[0].astype(float), sizes, 0.65)
    np.testing.assert_allclose(found, expected, rtol=3e-3, atol=1e-3)
    light = image[0].astype(float).mean(axis=(0, 1))
    np.testing.assert_allclose(found.mean(axis=(0, 1)), light, rtol=1e-3)
    # A lamp's halo: monotonic, and felt a tenth of the picture away.
    lamp = np.zeros_like(image)
    lamp[:, 48:50, 80:82] = 500.0
    halo = bloom.spread(lights().device, halves(lamp)).numpy()[0, 24, 40:, 0].astype(float)
    assert (np.diff(halo) <= 0.0).all()
    assert halo[5] > 0.05


def test_bloom_mixes_in_what_the_lens_scatters():
    lens = Lens(bloom=0.3)
    image = scene().astype(float)
    wide = reference.scattered(image[0], post_bloom.level_sizes(HEIGHT, WIDTH), 0.65)
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    wide = reference.bilinear(wide, 0.5 * rows - 0.25, 0.5 * columns - 0.25)
    close(run(["bloom"], lens)[0], reference.tone(0.7 * image[0] + 0.3 * wide))


def test_fringes_are_those_of_the_reference():
    lens = Lens(chromatic_aberration=0.02, cx=0.45)
    image = scene()[0].astype(float)
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    expected = image.copy()
    for channel, scale in ((0, 1.02), (2, 0.98)):
        y = (rows + 0.5 - HEIGHT / 2) / scale + HEIGHT / 2 - 0.5
        x = (columns + 0.5 - 0.45 * WIDTH) / scale + 0.45 * WIDTH - 0.5
        expected[..., channel] = reference.bilinear(image, y, x)[..., channel]
    close(run(["chromatic_aberration"], lens)[0], reference.tone(expected), share=0.9999)


def test_red_is_drawn_larger_and_blue_smaller():
    image = np.zeros((1, 64, 640, 3), np.float16)
    image[:, :, 600:604] = 2.0
    lens = Lens(chromatic_aberration=0.01)
    row = reference.signal_of(run(["chromatic_aberration"], lens, image)[0, 32])
    middles = (row * (np.arange(640) + 0.5)[:, None]).sum(axis=0) / row.sum(axis=0)
    radius = 602.0 - 320.0
    np.testing.assert_allclose(middles - 602.0, [0.01 * radius, 0.0, -0.01 * radius], atol=0.06)


def test_the_vignette_is_the_cosine_to_the_fourth():
    lens = Lens(vignette=0.6)
    grey = np.full((1, HEIGHT, WIDTH, 3), 0.5, np.float16)
    rows, columns = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    focal = WIDTH / 2 / math.tan(math.radians(35.0))
    tangent = np.hypot(columns - WIDTH / 2, rows - HEIGHT / 2) / focal
    passed = 1.0 - 0.6 * (1.0 - 1.0 / (1.0 + tangent**2) ** 2)
    np.testing.assert_allclose(falloff(lens, HEIGHT, WIDTH, 70.0), passed, rtol=1e-5)
    expected = reference.tone(np.repeat(0.5 * passed[..., None], 3, axis=-1))
    close(run(["vignette"], lens, grey)[0], expected)


@pytest.mark.parametrize("level", [0.1, 0.5, 2.0])
def test_grain_has_its_size_and_is_less_in_highlights(level):
    lens = Lens(grain=0.3)
    grey = np.full((1, HEIGHT, WIDTH, 3), level, np.float16)
    found = run(["grain"], lens, grey)[0]
    np.testing.assert_array_equal(found[..., 0], found[..., 1])
    numbers = reference.normals(1000, 3, 3 * HEIGHT * WIDTH + np.arange(HEIGHT * WIDTH))
    signal = np.float16(level) * (1.0 + 0.3 / (1.0 + level) * numbers.reshape(HEIGHT, WIDTH))
    close(found[..., 0], reference.tone(signal))
    values = reference.signal_of(found[..., 0])
    assert values.mean() == pytest.approx(level, rel=0.01)
    assert values.std() == pytest.approx(0.3 * level / (1.0 + level), rel=0.03)
    a, b = values[:, :-1].ravel(), values[:, 1:].ravel()
    assert abs(np.corrcoef(a, b)[0, 1]) < 0.03
    later = run(["grain"], lens, grey, light=lights(tick=4))[0]
    assert abs(np.corrcoef(found[..., 0].ravel(), later[..., 0].ravel())[0, 1]) < 0.03


def test_the_sensors_noise_is_shot_and_read_noise_of_its_stream():
    image = scene()[0].astype(float)
    numbers = reference.normals(1000, 3, np.arange(image.size)).reshape(image.shape)
    noisy = image + np.sqrt(image / 7000.0 + 1.2e-3**2) * numbers
    found = run([], light=lights(noise=True))[0]
    close(found, reference.tone(noisy))
    assert (found != run([])[0]).mean() > 0.3


def test_nothing_depends_on_the_slot_or_its_neighbours():
    image, depth = scene(slots=3), depths(slots=3)
    light = lights(3, noise=True)
    together = run(EFFECTS, PORTRAIT, image, depth, light=light)
    order = [2, 0, 1]
    turned = lights(3, noise=True)
    turned.host[:] = light.host[order]
    np.testing.assert_array_equal(
        run(EFFECTS, PORTRAIT, image[order], depth[order], light=turned), together[order]
    )
    alone = lights(1, noise=True)
    alone.host[0] = light.host[1]
    found = run(EFFECTS, PORTRAIT, image[1:2], depth[1:2], light=alone)
    np.testing.assert_array_equal(found[0], together[1])


def test_slots_that_are_not_active_keep_their_image():
    light = lights(2)
    light.host["active"][1] = 0
    out = run(EFFECTS, PORTRAIT, scene(slots=2), depths(slots=2), light=light)
    assert out[0].any()
    assert not out[1].any()


def test_odd_sizes_and_small_pictures_work():
    for height, width in ((9, 16), (37, 65)):
        image = np.full((1, height, width, 3), 0.5, np.float16)
        depth, flow = np.full((1, height, width), 3.0), np.full((1, height, width, 2), 4.0)
        lens = Lens(bloom=0.5, vignette=0, grain=0, sensor_width_mm=100.0, f_number=1.0)
        found = run(EFFECTS, lens, image, depth, flow)
        np.testing.assert_array_equal(found, reference.tone(np.full(found.shape, 0.5)))


def _arrays(thing: object) -> list[wp.array]:
    if isinstance(thing, wp.array):
        return [thing]
    if isinstance(thing, list):
        return [a for part in thing for a in _arrays(part)]
    if isinstance(thing, PostEffects | FocusBlur | MotionBlur | post_bloom.Bloom):
        return [a for part in vars(thing).values() for a in _arrays(part)]
    return []


@pytest.mark.parametrize("effects", [[], list(EFFECTS), ["bloom"], ["motion_blur", "vignette"]])
def test_memory_is_what_was_announced(effects):
    post = PostEffects(effects, Lens(), 3, 90, 161, CPU)
    placeholders = 64
    taken = sum(a.capacity for a in _arrays(post))
    assert bytes_needed(3, 90, 161, effects) == pytest.approx(taken, abs=placeholders)


def test_mistakes_are_one_line():
    with pytest.raises(ValueError, match="unknown effect 'blom'; did you mean 'bloom'"):
        PostEffects(["blom"], Lens(), 1, 36, 64, CPU)
    near = Lens(sensor_width_mm=100.0, focus_m=0.06)
    with pytest.raises(ValueError, match="focus_m must be larger"):
        PostEffects(["depth_of_field"], near, 1, 36, 64, CPU)


def test_the_bench_measures_every_effect():
    found = measure("cpu", 2, 64, 36)
    assert set(found["effects_ms"]) == {"tone", *EFFECTS}
    assert found["frames_per_s"] == pytest.approx(2e3 / found["chain_ms"])
    assert found["effects_ms"]["tone"] > 0.0
    assert found["chain_ms"] > 0.0
    assert found["bytes"] == bytes_needed(2, 36, 64, EFFECTS)
