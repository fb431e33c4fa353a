# SPDX-License-Identifier: Apache-2.0
"""Expected photos against simulated ones, and noise found again in photos."""

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from internal import color, losses
from internal.files import image_io
from internal.night.capture import CaptureModel, capture, sense, to_photo, view_key
from internal.scene import noise
from internal.scene.noise import NODES, Noise

CAMERA = CaptureModel(exposure=1.0, full_well=8000.0, read_noise=4.0)
LEVEL = 1.0 / (255.0 * 12.92)  # linear light of the first level


def noise_of(camera: CaptureModel) -> Noise:
    """Of ``capture.sense``: shot noise and read noise, both amplified by the gains."""
    gains = np.array(camera.channel_gains)
    floor = (gains * camera.read_noise / camera.full_well) ** 2
    return Noise(tuple(floor.tolist()), tuple((gains / camera.full_well).tolist()))


def test_the_expectation_is_that_of_simulated_photos():
    """Slow reference: Gaussian noise, clipping, the sRGB curve and rounding, often."""
    floor, growth = (1.5 * LEVEL) ** 2, 2e-4
    nodes = np.array([0, 2, 7, 20, 61, 300, 1018, 1020])
    x = np.asarray(color.srgb_to_linear(NODES[nodes]), np.float64)
    rng = np.random.default_rng(0)
    draws = rng.normal(size=(50_000, 1)) * np.sqrt(floor + growth * x)
    photos = np.asarray(color.to_uint8(color.linear_to_srgb(x + draws)), np.float64)
    mean, variance = (moment[nodes] for moment in noise.expectation(floor, growth))
    error = np.sqrt(variance / len(photos)) + 1e-3
    assert np.all(np.abs(photos.mean(axis=0) - mean) < 4.0 * error)
    np.testing.assert_allclose(photos.var(axis=0), variance, rtol=0.03)


@pytest.mark.parametrize("light", [0.0, 1e-4, 1e-3, 0.02])
def test_captures_of_a_colour_average_to_its_expected_photo(light):
    photos = capture(
        np.full((100, 100, 3), light, np.float32), CAMERA, view_key(CAMERA, 0)
    )
    colour = color.linear_to_srgb(light * jnp.array(CAMERA.channel_gains))
    expected = 255.0 * noise.expected_photo(noise_of(CAMERA))(colour)
    error = photos.std(axis=(0, 1)) / 100.0
    np.testing.assert_array_less(np.abs(photos.mean(axis=(0, 1)) - expected), 4 * error)


def test_without_noise_photos_show_colours_to_a_small_part_of_a_level():
    observe = noise.expected_photo(Noise((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    colours = jnp.tile(jnp.linspace(0.0, 1.0, 1000)[:, None], 3)
    np.testing.assert_allclose(observe(colours), colours, atol=0.07 / 255.0)


def test_black_looks_brighter_and_white_darker_and_order_is_kept():
    observe = noise.expected_photo(noise_of(CAMERA))
    photos = np.asarray(observe(jnp.tile(jnp.linspace(0.0, 1.2, 500)[:, None], 3)))
    assert np.all(photos[0] > 0.3 / 255.0)
    assert np.all(np.diff(photos, axis=0) > 0.0)
    assert np.all(photos[-1] < 1.2)


def test_a_colour_feels_its_photo_even_in_the_dark():
    observe = noise.expected_photo(noise_of(CAMERA))
    gradient = jax.grad(lambda c: jnp.sum(observe(c)))(jnp.array([0.0, 0.001, 0.5]))
    np.testing.assert_array_equal(gradient, jnp.ones(3))


def test_the_learned_colour_is_the_scene_and_not_its_photos_mean():
    """A colour of a quarter of a level, learned from many photos by either term."""
    light = np.full((100, 100, 3), 0.25 * LEVEL, np.float32)
    photos = jnp.asarray(to_photo(sense(light, CAMERA, view_key(CAMERA, 1)))) / 255.0
    truth = 0.25 / 255.0 * np.array(CAMERA.channel_gains)

    def learned(observe: noise.Observation) -> np.ndarray:
        def loss(colour):
            return losses.data_loss(
                observe(jnp.broadcast_to(colour, photos.shape)), photos, eps=0.01
            )

        step = jax.jit(lambda colour: colour - 2e-4 * jax.grad(loss)(colour))
        colour = jnp.full(3, 0.02)
        for _ in range(100):
            colour = jnp.maximum(step(colour), 0.0)
        return np.asarray(colour)

    biased = learned(noise.ideal_photo)
    unbiased = learned(noise.expected_photo(noise_of(CAMERA)))
    assert np.all(255.0 * (biased - truth) > 0.3)
    assert np.all(255.0 * np.abs(unbiased - truth) < 0.07)


@pytest.mark.parametrize("exposure", [1 / 10, 1 / 40])
def test_noise_is_found_again_in_photos_with_smooth_and_rough_parts(exposure):
    rng = np.random.default_rng(0)
    rows = np.linspace(0.0, 1.0, 160)[:, None, None] ** 2
    rough = rng.uniform(0.2, 1.0, (160, 60, 1))
    light = np.concatenate([np.repeat(rows, 140, axis=1), rows * rough], axis=1)
    light = np.repeat(light, 3, axis=2).astype(np.float32)
    camera = CaptureModel(exposure=exposure, full_well=5000.0, read_noise=2.0)
    photos = [capture(light, camera, view_key(camera, view)) for view in range(3)]
    found = noise.estimate_noise([photo / np.float32(255) for photo in photos])
    true = noise_of(camera)
    np.testing.assert_allclose(np.sqrt(found.floor), np.sqrt(true.floor), rtol=0.15)
    np.testing.assert_allclose(found.growth, true.growth, rtol=0.2)


def test_photos_without_noise_or_too_small_to_tell_have_none(tmp_path):
    smooth = np.linspace(0, 0.12, 100 * 120 * 3).reshape(100, 120, 3)
    for name, picture in ("all", smooth), ("corner", smooth[:9, :9]):
        image_io.write(tmp_path / f"{name}.png", picture.astype(np.float32))
    found = noise.noise_of_files([tmp_path / "all.png"])
    assert max(found.floor) < (0.1 * LEVEL) ** 2
    tiny = noise.noise_of_files([tmp_path / "corner.png"])
    assert tiny == Noise((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def test_the_noise_level_of_a_flat_picture_is_its_deviation():
    flat = 0.3 + 0.02 * np.random.default_rng(0).normal(size=(200, 200))
    assert noise.noise_level(flat) == pytest.approx(0.02, rel=0.03)


def test_the_run_folder_says_what_noise_was_found(tmp_path, capsys):
    noise.record(tmp_path, Noise((LEVEL**2, LEVEL**2, LEVEL**2), (1e-4, 1e-4, 1e-4)))
    assert "1.00, 1.00, 1.00 levels at black" in capsys.readouterr().out
    written = json.loads((tmp_path / "noise.json").read_text())
    assert written["growth"] == [1e-4] * 3
