# SPDX-License-Identifier: Apache-2.0
"""A look is what a configuration says, its bindings bring it back, and its gains are
those of the light that it names."""

import dataclasses

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from internal.configs import RenderConfig, load_config
from internal.enhancements.look import (
    LUMINANCE_WEIGHTS,
    NEUTRAL,
    LightEdit,
    Look,
    temperature_gains,
    tint_gains,
)
from internal.errors import UserError

KELVIN = st.floats(1700.0, 25000.0)


def test_the_default_look_is_neutral_and_the_configurations_default():
    assert RenderConfig().light() == Look()
    for edit in (NEUTRAL, Look().edit(), Look(1.0, 0.0, 6500.0).edit()):
        np.testing.assert_array_equal(edit.strength, np.float32(1.0))
        np.testing.assert_array_equal(edit.contrast, np.float32(1.0))
        np.testing.assert_array_equal(edit.gains, np.ones(3, np.float32))
        np.testing.assert_array_equal(edit.coded_gains, np.ones(3, np.float32))
        np.testing.assert_array_equal(edit.pivot, np.float32(1.0))
    np.testing.assert_array_equal(temperature_gains(6500.0), np.ones(3))


@given(
    st.builds(
        Look,
        strength=st.floats(0.0, 1.0),
        exposure=st.floats(-4.0, 4.0),
        temperature=st.floats(1700.0, 15000.0),
        tint=st.floats(-2.0, 2.0),
        contrast=st.floats(0.25, 4.0),
    )
)
def test_bindings_bring_a_look_back(look):
    config = load_config([], look.bindings())
    assert config.render.light() == look
    assert dataclasses.replace(config.render, **vars(look)) == config.render


def test_positive_tint_is_magenta_and_keeps_the_luminance_of_grey():
    red, green, blue = tint_gains(1.0)
    assert red == blue == pytest.approx(2.0 * green)  # one stop
    assert tint_gains(1.0) @ LUMINANCE_WEIGHTS == pytest.approx(1.0)
    np.testing.assert_array_equal(tint_gains(0.0), np.ones(3))


def test_an_edit_without_gains_keeps_the_rest():
    edit = Look(0.5, 1.0, 4000.0, 0.3, 1.5).edit()
    rest = edit.without_gains()
    np.testing.assert_array_equal(rest.gains, np.ones(3))
    assert (rest.strength, rest.contrast) == (edit.strength, edit.contrast)


@given(KELVIN)
def test_luminance_of_grey_is_kept_in_linear_light(kelvin):
    luminance = temperature_gains(kelvin) @ LUMINANCE_WEIGHTS
    assert luminance == pytest.approx(1.0)


@given(KELVIN, KELVIN)
def test_more_kelvin_is_bluer(one, other):
    warm = Look(temperature=min(one, other)).edit().gains
    cold = Look(temperature=max(one, other)).edit().gains
    assert warm[0] >= cold[0]
    assert warm[2] <= cold[2]


# Tabulated CIE 1931 chromaticities of black bodies, one per piece of the spline;
# 2856 K is illuminant A.
@pytest.mark.parametrize(
    "kelvin, x, y",
    [(2000.0, 0.5267, 0.4133), (2856.0, 0.4476, 0.4074), (10000.0, 0.2807, 0.2884)],
)
def test_gains_follow_the_planckian_locus(kelvin, x, y):
    neutral_x, neutral_y = 0.3135, 0.3237  # 6500 K
    rgb_from_xyz = np.array(
        [
            [3.2406, -1.5372, -0.4986],
            [-0.9689, 1.8758, 0.0415],
            [0.0557, -0.2040, 1.057],
        ]
    )
    rgb = rgb_from_xyz @ [x / y, 1.0, (1.0 - x - y) / y]
    neutral = rgb_from_xyz @ [
        neutral_x / neutral_y,
        1.0,
        (1.0 - neutral_x - neutral_y) / neutral_y,
    ]
    gains = temperature_gains(kelvin)
    np.testing.assert_allclose(
        gains / gains[1], rgb / neutral / (rgb / neutral)[1], rtol=7e-3, atol=3e-3
    )


def test_two_point_two_stops_double_the_coded_value():
    # 2 ** (2.2 / 2.2) = 2
    assert float(Look(exposure=2.2).edit().coded_gains[0]) == pytest.approx(2.0)
    assert float(Look(exposure=-2.2).edit().coded_gains[0]) == pytest.approx(0.5)


@pytest.mark.parametrize(
    "settings",
    [
        {"strength": -0.1},
        {"strength": 1.1},
        {"strength": float("nan")},
        {"exposure": float("inf")},
        {"exposure": -17.0},
        {"temperature": 1699.0},
        {"temperature": 25001.0},
        {"temperature": float("nan")},
        {"tint": 2.1},
        {"contrast": 0.0},
    ],
)
def test_out_of_range_is_one_line_that_names_the_setting(settings):
    (name,) = settings
    with pytest.raises(UserError, match=f"{name} = .*expected a number from") as caught:
        Look(**settings).edit()
    assert "\n" not in str(caught.value)


def test_an_edit_is_a_tree_that_compiled_code_takes():
    brighter = jax.jit(lambda edit: edit.replace(gains=2 * edit.gains))
    edit = brighter(NEUTRAL)
    assert isinstance(edit, LightEdit)
    assert float(edit.gains[0]) == 2.0
