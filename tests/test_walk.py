# SPDX-License-Identifier: Apache-2.0
"""Splats to walk on: their colours under any light, and how one bake serves all.

The browser that draws them is in test_walk_page.py.
"""

import dataclasses
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

from internal.configs import load_config
from internal.coord import Unbounded
from internal.enhancements.look import Look
from internal.errors import UserError
from internal.export.splats import SH0, Splats
from internal.models import Model
from internal.rendering.pictures import Display
from internal.structs import Level
from internal.training.step import initial_state
from internal.viewer.baking import Bakery, Walkable
from internal.viewer.canvas import NOTHING, PHOTO, Split
from internal.viewer.free_camera import FreeCamera
from internal.viewer.lit_splats import Baked, recolorer
from internal.viewer.sharing import Turns
from internal.viewer.studio import Studio
from internal.viewer.trained import Trained
from internal.viewer.walk import look_shown
from tests.conftest import TINY_ENHANCED, TINY_MLP, TINY_MODEL, TINY_SIZES

MODELS = {
    "gamma": TINY_MODEL,
    "tone": (
        *TINY_SIZES,
        *TINY_MLP,
        *TINY_ENHANCED,
        "Model.enhancement = @Tone()",
        "Tone.stops = 6.0",
    ),
}
BEFORE = Look(exposure=0.5, temperature=4000.0)
SPACE, CENTRES = Unbounded(np.float32(0.1), np.float32(4.0)), np.zeros((1, 3))
POINTS = np.random.default_rng(0).uniform(-0.5, 0.5, (40, 3))
SIZE = 0.1


@pytest.fixture(scope="module", params=MODELS)
def lit_field(request):
    """A tiny model, its parameters, and the colours that it gives points."""
    config = load_config([], MODELS[request.param])
    model = Model(config.model)
    params = initial_state(config, model).params

    def light(module, edit):
        rays = POINTS / np.linalg.norm(POINTS, axis=-1, keepdims=True)
        mean = jnp.float32(POINTS)[:, None]
        variance = jnp.full_like(mean, SIZE**2)
        samples = module.field(mean, variance, jnp.float32(rays), jnp.zeros((40, 1)))
        level = Level(jnp.zeros((40, 2)), jnp.ones((40, 1)), samples.rgb[:, 0], samples)
        return module.enhancement(level, edit).enhanced

    def lit(look):
        srgb: Any = model.apply({"params": params}, look.edit(), method=light)
        return np.clip(np.asarray(srgb), 0.0, 1.0)

    return model, params, lit


def baked(srgb):
    count = len(srgb)
    splats = Splats(
        POINTS.astype(np.float32),
        np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        np.log(np.tile(np.array([SIZE, SIZE, SIZE / 4], np.float32), (count, 1))),
        np.zeros(count, np.float32),
        ((srgb - 0.5) / SH0).astype(np.float32)[:, None],
    )
    return Baked(splats, BEFORE, step=7)


@pytest.mark.parametrize(
    "look",
    [BEFORE, Look(), Look(strength=0.7), Look(exposure=-2.0, tint=0.5, contrast=2.0)],
    ids=["as baked", "neutral", "weaker", "other"],
)
def test_recoloured_splats_have_the_colours_that_baking_in_that_look_gives(
    lit_field, look
):
    model, params, lit = lit_field
    recolor = recolorer(model, params, SPACE, CENTRES, baked(lit(BEFORE)))
    expected = lit(look)
    assert expected.max() > 0.01
    np.testing.assert_allclose(recolor(look) / 255.0, expected, atol=1.5 / 255)


def test_what_fitting_changed_of_a_colour_stays_changed(lit_field):
    model, params, lit = lit_field
    darker = 0.5 * lit(BEFORE)
    recolor = recolorer(model, params, SPACE, CENTRES, baked(darker))
    np.testing.assert_allclose(recolor(BEFORE) / 255.0, darker, atol=1.5 / 255)
    assert np.all(recolor(Look(exposure=-2.0)) <= recolor(BEFORE))


def test_splats_of_a_plain_field_keep_their_colours(tiny_config):
    plain = Model(dataclasses.replace(tiny_config.model, enhancement=None))
    recolor = recolorer(plain, {}, SPACE, CENTRES, baked(np.full((40, 3), 0.4)))
    np.testing.assert_array_equal(recolor(Look(exposure=2.0)), 102)


def test_splats_show_the_lit_and_the_dark_picture_and_no_other():
    look = Look(exposure=1.0)
    assert look_shown(Split("enhanced", NOTHING), look) == look
    assert look_shown(Split("dark", NOTHING), look) == Look(strength=0.0)
    for choice in (Split("depth"), Split("enhanced", PHOTO), Split(PHOTO)):
        assert look_shown(choice, look) is None


def test_a_pixel_apart_looks_alike_and_a_step_does_not():
    here = FreeCamera(np.eye(4)[:3], 0.8, 1.5)

    def beside(distance):
        pose = np.eye(4)[:3]
        pose[0, 3] = distance
        return FreeCamera(pose, 0.8, 1.5)

    assert here.looks_like(beside(1e-3)) and not here.is_at(beside(1e-3))
    assert not here.looks_like(beside(0.01))


class TestBakery(Bakery):
    """Bakes in three steps, or fails in the second."""

    __test__ = False

    def __init__(self, fails=False):
        studio = object.__new__(Studio)
        studio.turns, studio.trained = Turns(), Trained({}, 7, Display({}, {}, 1.0))
        super().__init__(studio, Path(), 5)
        self.turns, self.fails, self.made, self.heard = studio.turns, fails, [], []
        self.listen(self.hear)

    def hear(self):
        self.heard.append(self.share)

    def _prepare(self, trained):
        yield 0.3
        if self.fails:
            raise UserError("no splats to walk on: no surface")
        yield 0.6
        colors = np.zeros((40, 3), np.uint8)
        self.made.append(Walkable(baked(colors / 255.0), lambda look: colors))
        return self.made[-1]


def work(bakery):
    while bakery.turns.take_one():
        pass


def test_one_bake_serves_all_pages_and_tells_them_how_far_it_is():
    bakery = TestBakery()
    bakery.start()
    bakery.start()  # somebody else presses the button
    work(bakery)
    assert bakery.heard == [0.0, 0.3, 0.6, None]
    assert [bakery.walkable] == bakery.made
    bakery.start()
    work(bakery)
    assert len(bakery.made) == 2


def test_a_bake_waits_for_pictures_that_somebody_waits_for():
    bakery = TestBakery()
    bakery.start()
    seen: list[float | None] = []

    class Urgent:
        def urgency(self):
            return 2 * (len(seen) < 2)

        def step(self):
            seen.append(bakery.share)

        def failed(self, error):
            raise error

    bakery.turns.join(Urgent())
    work(bakery)
    assert seen == [0.0, 0.0] and bakery.walkable


def test_a_bake_that_fails_says_why_and_may_be_tried_again():
    bakery = TestBakery(fails=True)
    bakery.start()
    work(bakery)
    assert bakery.walkable is None and bakery.share is None
    assert bakery.failure == "no splats to walk on: no surface"
    bakery.fails = False
    bakery.start()
    work(bakery)
    assert bakery.walkable and not bakery.failure


def test_splats_of_an_older_model_are_dropped_baked_or_not():
    bakery = TestBakery()
    bakery.start()
    bakery.turns.take_one()
    bakery.outdated()
    work(bakery)
    assert not bakery.made and bakery.share is None
    bakery.start()
    work(bakery)
    bakery.outdated()
    assert bakery.walkable is None


def test_a_page_that_left_hears_nothing_more():
    bakery = TestBakery()
    bakery.forget(bakery.hear)
    bakery.start()
    work(bakery)
    assert bakery.heard == []
