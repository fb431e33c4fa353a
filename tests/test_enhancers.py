# SPDX-License-Identifier: Apache-2.0
"""Laws of the classical 2-D enhancers."""

import numpy as np
import pytest
import scipy.optimize

from internal import extras
from internal.comparison import enhancers, lime

needs_opencv = pytest.mark.skipif(
    not extras.has("cv2"), reason="the extra enhance2d is not installed"
)


def _dark_picture(height: int = 48, width: int = 64) -> np.ndarray:
    """A dark scene of two lights and three colours, with noise, in 8-bit levels."""
    rng = np.random.default_rng(0)
    picture = np.full((height, width, 3), [0.10, 0.08, 0.05], np.float32)
    picture[:, width // 2 :] *= 0.4
    picture[height // 3 : height // 2] *= np.array([1.5, 0.7, 0.5], np.float32)
    noisy = picture + rng.normal(0.0, 0.006, picture.shape)
    return (np.round(np.clip(noisy, 0, 1) * 255) / 255).astype(np.float32)


@needs_opencv
@pytest.mark.parametrize("name", enhancers.ENHANCERS)
def test_every_enhancer_brightens_and_stays_a_picture(name):
    dark = _dark_picture()
    bright = enhancers.ENHANCERS[name](dark)
    assert bright.shape == dark.shape and bright.dtype == np.float32
    assert bright.min() >= 0.0 and bright.max() <= 1.0
    assert bright.mean() > 3.0 * dark.mean()
    np.testing.assert_array_equal(bright, enhancers.ENHANCERS[name](dark))


@needs_opencv
@pytest.mark.parametrize("name", ["clahe", "lime"])
def test_black_stays_black_and_finite(name):
    black = np.zeros((24, 32, 3), np.float32)
    np.testing.assert_array_equal(enhancers.ENHANCERS[name](black), black)


@needs_opencv
@pytest.mark.parametrize("name", ["clahe", "lime"])
def test_denoising_removes_noise_and_keeps_the_light(name):
    noisy = enhancers.ENHANCERS[name](_dark_picture())
    clean = enhancers.ENHANCERS[f"{name}_denoised"](_dark_picture())
    flat = np.s_[2:14, 2:30]
    assert clean[flat].std(axis=(0, 1)).max() < 0.7 * noisy[flat].std(axis=(0, 1)).max()
    assert clean.mean() == pytest.approx(noisy.mean(), abs=0.02)


@needs_opencv
def test_denoising_keeps_fine_texture():
    y, x = np.mgrid[:48, :64]
    stripes = (0.5 + 0.2 * np.sign(np.sin(x * 1.6) + np.sin(y * 1.6)))[..., None]
    texture = np.repeat(stripes, 3, axis=-1).astype(np.float32)
    assert enhancers.denoise(texture).std() > 0.9 * texture.std()


def test_lime_scales_a_pixels_channels_alike():
    dark = np.maximum(0.3 * _dark_picture(), 0.01)
    gains = lime.lime(dark) / dark
    inside = (lime.lime(dark) < 1.0).all(axis=-1)
    np.testing.assert_allclose(gains.max(-1)[inside], gains.min(-1)[inside], rtol=1e-4)


def test_a_flat_light_is_its_own_smooth_map():
    light = np.full((12, 10), 0.2)
    np.testing.assert_allclose(lime.smooth_light(light), light)


def test_the_smooth_map_minimises_the_papers_energy():
    light = np.random.default_rng(0).uniform(0.05, 0.3, (5, 6))
    weights = [lime.edge_weights(light, axis) for axis in (0, 1)]

    def energy(values):
        found = values.reshape(light.shape)
        rough = sum(
            np.sum(w * np.diff(found, axis=axis) ** 2) for axis, w in enumerate(weights)
        )
        return np.sum((found - light) ** 2) + lime.SMOOTHNESS * rough

    best = scipy.optimize.minimize(energy, light.ravel(), method="BFGS", tol=1e-9)
    np.testing.assert_allclose(lime.smooth_light(light).ravel(), best.x, atol=1e-4)


def test_the_smooth_map_keeps_edges_and_levels_texture():
    rng = np.random.default_rng(0)
    light = np.where(np.arange(60) < 30, 0.1, 0.6) + rng.uniform(-0.03, 0.03, (40, 60))
    smooth = lime.smooth_light(light)
    assert smooth[:, 5:25].std() < 0.3 * light[:, 5:25].std()
    step = smooth[:, 31].mean() - smooth[:, 28].mean()
    assert step > 0.8 * 0.5
