# SPDX-License-Identifier: Apache-2.0
"""Walking on splats in the live viewer, in a real headless Chromium."""

import dataclasses
import shutil

import numpy as np
import pytest

from internal.enhancements.look import Look
from internal.export import bake, rasterizer
from internal.export.splats import SH0, pinhole_camera
from internal.scene import colmap
from internal.scoring.metrics import psnr
from internal.viewer import walk
from tests.browser import chromium, until
from tests.conftest import bindings

WIDTH, HEIGHT, ZOOM = 36, 32, 16

IS_SHOWN = "() => window.__viserSceneTree?.getState()['/splats']?.effectiveVisibility"
BARELY = 1.0  # dB
TEN_FRAMES = """() => new Promise((done) => {
  let drawn = 0;
  const next = () => (++drawn > 10 ? done() : requestAnimationFrame(next));
  next();
})"""


@pytest.fixture(scope="module")
def viewer(night, night_run, tmp_path_factory):
    pytest.importorskip("viser")
    from tests.viewer_page import ViewerPage

    folder = tmp_path_factory.mktemp("walk") / "run"
    shutil.copytree(night_run, folder)
    own = f"Config.checkpoint_dir = {str(folder)!r}"
    with chromium() as browser, pytest.MonkeyPatch.context() as patch:
        patch.setattr(bake, "STEPS", 3)
        patch.setattr(walk, "SLOW", 1e6)  # here no browser is
        page = ViewerPage(browser, folder, [*bindings(night), own], splats=300)
        page.open_tab("Photos")
        page.page.get_by_label("Show photos").uncheck()
        page.open_tab("Light")
        page.press("Bake splats to walk on")
        bakery = page.bakery
        until(lambda: bakery and bakery.walkable, "baked splats")
        page.page.get_by_text("splats, drawn by your computer").wait_for()
        yield page
        page.close()


def is_shown(viewer):
    return viewer.page.evaluate(IS_SHOWN)


def level(picture):
    """Mean of each channel."""
    return picture.reshape(-1, 3).mean(axis=0)


def test_splats_are_seen_while_the_camera_moves_and_the_field_at_rest(viewer):
    viewer.start_over()
    until(lambda: not is_shown(viewer), "the field alone")
    mouse, frames = viewer.page.mouse, len(viewer.frames)
    mouse.move(300, 300)
    mouse.down()
    mouse.move(330, 310, steps=3)
    until(lambda: is_shown(viewer), "splats")
    mouse.up()
    viewer.settle()
    until(lambda: not is_shown(viewer), "the field's picture again")
    assert all(frame.finished for frame in viewer.frames[frames:])
    step = 20.0 * np.log10(level(viewer.drawn()) / level(viewer.frame / 255.0))
    assert np.abs(step).max() < 0.3  # the background shows what was sent


def test_splats_are_drawn_in_the_colours_of_the_light_as_our_rasterizer_does(viewer):
    viewer.start_over()
    viewer.type_in("Exposure", "1")
    viewer.type_in("Kelvin", "4000")
    viewer.settle()
    until(lambda: not is_shown(viewer), "the field alone")
    walkable, camera = viewer.bakery.walkable, viewer.cameras[-1]
    srgb = walkable.recolor(Look(exposure=1.0, temperature=4000.0)) / 255.0
    lit = ((srgb - 0.5) / SH0).astype(np.float32)[:, None]
    lens = camera.lens(WIDTH * HEIGHT)
    wide = colmap.scale_lens(lens, ZOOM * WIDTH, ZOOM * HEIGHT)
    pinhole = pinhole_camera(wide, camera.camtoworld, near=0.01)
    whole = dataclasses.replace(walkable.baked.splats, harmonics=lit)
    picture = np.asarray(rasterizer.rasterize(whole, pinhole)[0])
    expected = viewer.middles(picture.clip(0.0, 1.0))

    ((panel, _),) = viewer.server._pages.values()
    panel.walk.light_anew()
    until(lambda: is_shown(viewer), "splats")
    drawn = viewer.drawn()
    step = 20.0 * np.log10(level(drawn) / level(expected))
    assert np.abs(step).max() < BARELY
    assert psnr(drawn, expected) > 25.0
    red, _, blue = level(drawn)
    assert red > 1.3 * blue


def test_what_splats_cannot_show_is_walked_through_as_without_them(viewer):
    viewer.start_over()
    viewer.choose("Picture", "depth")
    frames = len(viewer.frames)
    viewer.drag((300, 300), (320, 300))
    until(lambda: len(viewer.frames) > frames, "a picture of the depth")
    assert not is_shown(viewer)
    viewer.settle()


def test_another_page_has_splats_of_its_own(viewer):
    other = viewer.browser.new_page(viewport={"width": 600, "height": 400})
    other.goto(viewer.server.address)
    until(lambda: other.evaluate(IS_SHOWN) is not None, "the other's splats")
    assert not is_shown(viewer)
    other.close()


def test_a_browser_that_draws_splats_slowly_walks_on_the_field(viewer, monkeypatch):
    monkeypatch.setattr(walk, "SLOW", 0.0)  # as every browser is
    other = viewer.browser.new_page(viewport={"width": 600, "height": 400})
    other.goto(viewer.server.address)
    choice = other.get_by_label(walk.WALK)
    until(lambda: other.evaluate(IS_SHOWN) is not None, "the other's splats")
    assert choice.is_checked() and viewer.page.get_by_label(walk.WALK).is_checked()
    *_, (panel, session) = viewer.server._pages.values()
    until(lambda: session.is_walking, "a first picture")
    panel.walk.light_anew()
    until(lambda: not choice.is_checked(), "the choice taken back")
    until(lambda: not session.may_walk, "a walk on the field")
    assert viewer.page.get_by_label(walk.WALK).is_checked()
    choice.check()  # stays, once the user wants it
    until(lambda: session.may_walk, "splats again")
    panel.walk.light_anew()
    until(lambda: other.evaluate(IS_SHOWN), "splats")
    other.evaluate(TEN_FRAMES)
    assert choice.is_checked()
    other.close()
