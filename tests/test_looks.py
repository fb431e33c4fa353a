# SPDX-License-Identifier: Apache-2.0
"""A look is what a configuration says, and its bindings bring it back."""

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
    Look,
    tint_gains,
)


def test_the_default_look_is_neutral_and_the_configurations_default():
    assert RenderConfig().light() == Look()
    for ours, neutral in zip(
        jax.tree.leaves(Look().edit()), jax.tree.leaves(NEUTRAL), strict=True
    ):
        np.testing.assert_array_equal(ours, neutral)


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


def test_contrast_turns_about_middle_grey():
    for contrast in (0.5, 1.0, 2.0):
        edit = Look(contrast=contrast).edit()
        grey = 0.5 ** float(edit.contrast) * float(edit.pivot)
        np.testing.assert_allclose(grey, 0.5, rtol=1e-6)


def test_an_edit_without_gains_keeps_the_rest():
    edit = Look(0.5, 1.0, 4000.0, 0.3, 1.5).edit()
    rest = edit.without_gains()
    np.testing.assert_array_equal(rest.gains, np.ones(3))
    assert (rest.strength, rest.contrast) == (edit.strength, edit.contrast)
