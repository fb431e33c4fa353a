# SPDX-License-Identifier: Apache-2.0
"""Colours of a file are those that its profile or its codes mean."""

import io

import numpy as np
import pytest
from PIL import Image, ImageCms

from internal.files import color_profile
from internal.files.color_profile import HLG, PQ, from_codes, from_icc, to_srgb
from tests.icc_writer import grey_profile, profile, rgb_profile

COLORS = np.random.default_rng(0).integers(0, 256, (60, 60, 3), dtype=np.uint8)
STORED = COLORS.astype(np.float32) / 255.0


def by_little_cms(picture: Image.Image, icc: bytes) -> np.ndarray:
    srgb = ImageCms.createProfile("sRGB")
    file = io.BytesIO(icc)
    intent = ImageCms.Intent.RELATIVE_COLORIMETRIC
    done = ImageCms.profileToProfile(
        picture, file, srgb, renderingIntent=intent, outputMode="RGB"
    )
    return np.asarray(done).astype(float)


@pytest.mark.parametrize("name", ["Display P3", "Adobe RGB", "ProPhoto"])
@pytest.mark.parametrize("sampled", [False, True])
def test_profiles_mean_what_little_cms_says(name, sampled):
    icc = rgb_profile(name, sampled)
    ours = to_srgb(STORED, from_icc(icc, 3)) * 255.0
    expected = by_little_cms(Image.fromarray(COLORS), icc)
    assert np.abs(ours - expected).max() < 1.1  # it rounds on its way
    assert np.abs(expected - COLORS).max() > 50.0


@pytest.mark.parametrize("sampled", [False, True])
def test_srgb_changes_no_bit(sampled):
    encoding = from_icc(rgb_profile("sRGB", sampled), 3)
    assert to_srgb(STORED, encoding) is STORED
    built_in = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    assert from_icc(built_in, 3).is_srgb
    assert to_srgb(STORED, None) is STORED


def test_grey_profiles_and_grey_pixels_stay_grey():
    grey = np.arange(256, dtype=np.uint8)[None]
    icc = grey_profile(1.8)
    ours = to_srgb(grey[..., None] / np.float32(255), from_icc(icc, 1))
    expected = by_little_cms(Image.fromarray(grey), icc)[..., :1]
    # Its table is coarse near black: 1.47 levels off the power at level 2.
    np.testing.assert_allclose(ours * 255.0, expected, atol=1.6)
    with_rgb = from_icc(rgb_profile("ProPhoto"), 1)
    np.testing.assert_allclose(to_srgb(grey[..., None] / 255.0, with_rgb), ours, 1e-2)


@pytest.mark.parametrize(
    ("icc", "channels", "reason"),
    [
        (profile({"A2B0": b"mft2"}), 3, "is a table"),
        (profile({}, b"CMYK"), 3, "is for CMYK"),
        (grey_profile(2.2), 3, "is for GRAY"),
        (rgb_profile("ProPhoto")[:300], 3, "is broken"),
        (b"junk", 3, "is for nothing"),
        (profile({"rXYZ": b"XYZ "}), 3, "is broken"),
    ],
)
def test_other_profiles_say_why(icc, channels, reason):
    with pytest.raises(color_profile.ProfileError, match=reason):
        from_icc(icc, channels)


def test_wide_primaries_by_code_are_those_of_the_profile():
    by_code = to_srgb(STORED, from_codes(12, 13))
    np.testing.assert_allclose(
        by_code, to_srgb(STORED, from_icc(rgb_profile("Display P3"), 3)), atol=3e-3
    )
    adobe = to_srgb(STORED, color_profile.adobe_rgb())
    expected = to_srgb(STORED, from_icc(rgb_profile("Adobe RGB"), 3))
    np.testing.assert_allclose(adobe, expected, atol=3e-3)


@pytest.mark.parametrize("codes", [(1, 1), (1, 13), (2, 2), (6, 6), (5, 6)])
def test_what_is_shown_as_srgb_is_left_alone(codes):
    assert from_codes(*codes) is None


@pytest.mark.parametrize(
    ("transfer", "signal", "cd_per_m2"),
    [  # of grey, from BT.2408: 203 is PQ 58 %, HLG 75 %; 26 is PQ 38 %, HLG 38 %
        (PQ, 0.5806, 203.0),
        (HLG, 0.7499, 203.0),
        (PQ, 0.3808, 26.0),
        (HLG, 0.3757, 26.0),
        (PQ, 0.9, 203.0),  # lighter than white is white
        (HLG, 1.0, 203.0),
    ],
)
def test_hdr_is_display_light_over_the_white_of_203(transfer, signal, cd_per_m2):
    grey = np.full((1, 1, 3), signal, np.float32)
    expected = color_profile.encode_srgb(np.array(cd_per_m2 / 203.0))
    srgb = to_srgb(grey, from_codes(9, transfer))
    np.testing.assert_allclose(srgb, np.full((1, 1, 3), expected), atol=0.006)
