# SPDX-License-Identifier: Apache-2.0
"""The pages as a person uses them, in a real headless Chromium.

What the live viewer draws is compared with what render.py writes for the same camera
and light. All tests share a browser, a viewer and its first page.
"""

import csv
import json
import shutil
import types

import numpy as np
import pytest

import eval as eval_script
import render as render_script
import study as study_script
from internal import image_io
from internal.study.answers import preferences, read_answers
from tests.browser import chromium, until
from tests.conftest import bindings, flags
from tests.scene_writers import write_pictures

JPEG_ERROR, JPEG_MEAN_ERROR = 20 / 255, 3 / 255  # of the quality of finished frames
ROUNDING = 1.5 / 255


@pytest.fixture(scope="module")
def browser():
    with chromium() as running:
        yield running


@pytest.fixture(scope="module")
def run(browser, night, night_run, tmp_path_factory):
    """A run to train on in, and its scene."""
    folder = tmp_path_factory.mktemp("browser") / "run"
    shutil.copytree(night_run, folder)
    return types.SimpleNamespace(scene=night, folder=folder)


@pytest.fixture(scope="module")
def shared(run, browser):
    pytest.importorskip("viser")
    from tests.viewer_page import ViewerPage

    own = f"Config.checkpoint_dir = {str(run.folder)!r}", "Render.fps = 5"
    viewer = ViewerPage(browser, run.folder, [*bindings(run.scene), *own])
    viewer.open_tab("Photos")
    viewer.page.get_by_label("Show photos").uncheck()
    yield viewer
    viewer.close()


@pytest.fixture
def viewer(shared):
    shared.start_over()
    return shared


def rendered(run, record):
    """The folder of what render.py makes of a snapshot's or a path's JSON."""
    light = json.loads(record.read_text()).get("gin_bindings", [])
    path = f"Render.path = {str(record)!r}"
    assert render_script.main(flags(run.scene, run.folder, *light, path)) == 0
    return run.folder / "render" / record.stem


def assert_shown(viewer, picture):
    """The window shows what render.py wrote, as sent and as drawn on the screen."""
    expected = image_io.read_srgb(picture)

    def is_sent():
        return np.abs(viewer.frame / 255.0 - expected).max() < ROUNDING

    until(is_sent, f"a frame like {picture}")
    until(lambda: looks_like(viewer.drawn(), expected), f"a screen like {picture}")


def looks_like(drawn, expected):
    errors = np.abs(drawn - expected)
    return errors.max() < JPEG_ERROR and errors.mean() < JPEG_MEAN_ERROR


def test_the_first_screen_shows_the_scene_and_explains_itself(viewer):
    text = viewer.page.inner_text("body")
    assert "drag to turn" in text
    assert "frames/s" in text
    assert "the lit scene" in text
    until(lambda: looks_like(viewer.drawn(), viewer.frame / 255.0), "a drawn picture")


def test_every_step_draws_what_render_py_writes(viewer, run):
    start = viewer.cameras[-1].camtoworld
    viewer.drag((300, 300), (330, 310))
    viewer.settle()
    assert np.abs(viewer.cameras[-1].camtoworld - start).max() > 0.01
    moved = viewer.snapshot()
    neutral = rendered(run, moved) / "enhanced" / "0000.png"
    assert_shown(viewer, neutral)
    shot, expected = (
        image_io.read_srgb(p) for p in (moved.with_suffix(".png"), neutral)
    )
    np.testing.assert_allclose(shot, expected, atol=ROUNDING)

    computed = viewer.frames[-1].number
    viewer.type_in("Exposure", "1")
    viewer.type_in("Kelvin", "3500")
    until(lambda: "3500.0" in viewer.control("For gin").input_value(), "the bindings")
    record = viewer.snapshot()
    assert "Render.exposure = 1.0" in json.loads(record.read_text())["gin_bindings"]
    folder = rendered(run, record)
    warm = folder / "enhanced" / "0000.png"
    assert_shown(viewer, warm)
    red, _, blue = (image_io.read_srgb(warm) / expected).reshape(-1, 3).mean(axis=0)
    assert red > 1.3 * blue

    viewer.choose("Picture", "r")
    assert_shown(viewer, folder / "r" / "0000.png")
    assert viewer.frames[-1].number == computed  # light and choice cost no rendering


def test_a_report_slides_and_chooses(run, browser):
    assert eval_script.main(flags(run.scene, run.folder)) == 0
    page = browser.new_page()
    requests = []
    page.on("request", lambda request: requests.append(request.url))
    page.goto((run.folder / "eval" / "index.html").as_uri())
    stage = page.locator(".compare .stage")
    page.get_by_label("border").fill("20")
    assert "20%" in stage.get_attribute("style")
    page.get_by_label("Left").select_option("truth")
    left = stage.locator("img.left")
    assert left.get_attribute("src") == "truth/000.png"
    assert left.evaluate("image => image.decode().then(() => image.naturalWidth)") == 36
    text = page.inner_text("body")
    assert "Configuration" in text and "Training" in text
    assert all(url.startswith("file:") for url in requests)
    page.close()


def test_a_study_is_answered_and_evaluated(browser, tmp_path):
    write_pictures(tmp_path / "ours", ["0.png", "1.png"], 200.0)
    write_pictures(tmp_path / "theirs", ["0.png", "1.png"], 50.0)
    methods = [f"{name}={tmp_path / name}" for name in ("ours", "theirs")]
    out = tmp_path / "study"
    assert study_script.main(["make", str(out), *methods]) == 0
    context = browser.new_context(accept_downloads=True)
    page = context.new_page()
    page.goto((out / "index.html").as_uri())
    page.get_by_label("Your name").fill("Ann")
    page.get_by_role("button", name="Start").click()
    assert "1 of 2" in page.inner_text("body")
    better = "left" if "/0/" in page.locator("#left").get_attribute("src") else "right"
    page.get_by_role("button", name=f"{better} one is better").click()
    page.reload()  # answers are kept
    page.get_by_label("Your name").fill("Ann")
    page.get_by_role("button", name="Start").click()
    assert "2 of 2" in page.inner_text("body")
    page.keyboard.press("ArrowDown")
    with page.expect_download() as download:
        page.get_by_role("button", name="Download").click()
    file = tmp_path / "ann.csv"
    download.value.save_as(file)
    context.close()
    assert [row["answer"] for row in csv.DictReader(file.open())] == ["A", "undecided"]
    (result,) = preferences(read_answers([file]))
    assert (result.rival, result.a_better) == ("theirs", 0.5)
