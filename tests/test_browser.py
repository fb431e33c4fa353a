# SPDX-License-Identifier: Apache-2.0
"""The pages as a person uses them, in a real headless Chromium.

What the live viewer draws is compared with what render.py writes for the same camera
and light.
"""

import csv
import json
import socket
import time
import types

import numpy as np
import pytest

import eval as eval_script
import make_scene
import render as render_script
import study as study_script
import train as train_script
from internal import image_io, paths
from internal.cli import load_split
from internal.configs import load_config
from internal.study.answers import preferences, read_answers
from tests.browser import chromium, until
from tests.conftest import TINY_MODEL
from tests.scene_writers import write_pictures
from tests.test_scripts import flags

SIZE = "200 x 150"
CANVAS_WIDTH = 630  # of 960 pixels; the panel has the rest


@pytest.fixture(scope="module")
def browser():
    yield from chromium()


@pytest.fixture(scope="module")
def run(browser, tmp_path_factory):
    """A trained tiny run and its scene."""
    scene = tmp_path_factory.mktemp("scenes") / "night"
    size = ["--views", "6", "--width", "36", "--height", "32"]
    make_scene.main(["night", str(scene), *size])
    folder = tmp_path_factory.mktemp("runs") / "night"
    assert train_script.main(flags(scene, folder)) == 0
    return types.SimpleNamespace(scene=scene, folder=folder)


@pytest.fixture(scope="module")
def viewer(run, browser):
    """A page of the live viewer, and the frames that it was sent."""
    pytest.importorskip("viser")
    from internal.viewer.panel import Panel
    from internal.viewer.server import Server
    from internal.viewer.studio import Studio

    own = (
        f"Config.data_dir = {str(run.scene)!r}",
        f"Config.checkpoint_dir = {str(run.folder)!r}",
        "Render.chunk = 4096",
    )
    config = load_config([], [*TINY_MODEL, *own])
    studio = Studio(config, load_split(config, "train"))
    frames, show = [], Panel.show

    def remember(panel, frame):
        show(panel, frame)
        frames.append(frame)

    patch = pytest.MonkeyPatch()
    patch.setattr(Panel, "show", remember)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    server = Server(config, studio, "127.0.0.1", port)
    page = browser.new_page(viewport={"width": 960, "height": 512})
    page.goto(server.address)
    until(lambda: frames, "a first picture")
    choose(page, "500 x 375", SIZE)
    settle(frames, 0)
    yield types.SimpleNamespace(page=page, frames=frames, server=server, run=run)
    server.close()
    patch.undo()


def choose(page, current, wanted):
    """Picks from the dropdown that shows ``current``; the first of several."""
    boxes = page.locator("input:visible").all()
    next(box for box in boxes if box.input_value() == current).click()
    page.get_by_role("option", name=wanted, exact=True).click()


def settle(frames, after):
    """Waits for a finished frame that is newer than number ``after`` and stays: the
    page's camera glides on for a while after it is let go."""

    def stays():
        last = frames[-1]
        if not last.finished or last.number <= after:
            return False
        time.sleep(1.5)
        return frames[-1] is last

    until(stays, "a newer picture that stays")


def type_in(page, current, wanted):
    """Types into the number beside the slider that stands at ``current``."""
    boxes = page.locator("input:visible").all()
    box = next(box for box in boxes if box.input_value() == current)
    box.fill(wanted)
    box.press("Enter")


def on_screen(viewer):
    """Waits until the browser draws the newest frame. Notifications cover the top, so
    the mean colour of the lower half is compared."""
    shot = viewer.run.folder / "screen.png"

    def is_shown():
        sent = viewer.frames[-1].picture.astype(np.float32) / 255.0
        viewer.page.screenshot(path=str(shot))
        drawn = image_io.read_srgb(shot)[:, :CANVAS_WIDTH]
        lower = [image[len(image) // 2 :].mean(axis=(0, 1)) for image in (drawn, sent)]
        return np.abs(lower[0] - lower[1]).max() < 0.02

    until(is_shown, "the screen showing the newest frame")


def test_the_first_screen_shows_the_scene_and_explains_itself(viewer):
    text = viewer.page.inner_text("body")
    assert "drag to turn" in text
    assert "frames/s" in text
    on_screen(viewer)


def test_dragging_moves_the_camera_coarse_then_fine(viewer):
    number = viewer.frames[-1].number
    mouse = viewer.page.mouse
    mouse.move(300, 300)
    mouse.down()
    mouse.move(330, 310, steps=8)
    mouse.up()
    settle(viewer.frames, number)
    on_screen(viewer)


def test_light_sliders_change_the_picture_and_state_their_bindings(viewer):
    frames, page = viewer.frames, viewer.page
    before, number = frames[-1].picture.mean(), frames[-1].number
    type_in(page, "0", "1")  # exposure
    until(lambda: frames[-1].picture.mean() > 1.15 * before, "a brighter picture")
    type_in(page, "6500", "3500")

    def is_warm():
        red, _, blue = frames[-1].picture.reshape(-1, 3).mean(axis=0)
        return red > 1.2 * blue

    until(is_warm, "a warmer picture")
    on_screen(viewer)
    assert frames[-1].number == number  # nothing was rendered for it
    bindings = page.locator("textarea").first.input_value()
    assert "Render.exposure = 1.0" in bindings
    assert "Render.temperature = 3500.0" in bindings


def test_a_snapshot_is_what_render_py_writes_for_its_file(viewer):
    folder = viewer.run.folder / "view"
    viewer.page.get_by_role("button", name="Snapshot").click()
    until(lambda: list(folder.glob("snapshot_*.json")), "a snapshot")
    (record,) = folder.glob("snapshot_*.json")
    bindings = json.loads(record.read_text())["gin_bindings"]
    arguments = flags(viewer.run.scene, viewer.run.folder, *bindings)
    assert render_script.main(arguments) == 0
    rendered = viewer.run.folder / "render" / record.stem / "enhanced" / "0000.png"
    shot = image_io.read_srgb(record.with_suffix(".png"))
    np.testing.assert_allclose(shot, image_io.read_srgb(rendered), atol=1.5 / 255.0)

    # The window shows the same camera: its middle is the photo's, at another size,
    # so single pixels of this hardly trained scene differ and their mean does not.
    frame = viewer.frames[-1].picture.astype(np.float32) / 255.0
    height, width, _ = frame.shape
    margin = (width - round(height * 36 / 32)) // 2
    middle = image_io.resize_area(frame[:, margin : width - margin], 36, 32)
    np.testing.assert_allclose(middle, shot, atol=0.12)
    assert np.abs(middle - shot).mean() < 0.02


def test_another_output_is_a_choice_away(viewer):
    page, frames = viewer.page, viewer.frames
    before = frames[-1].picture
    choose(page, "enhanced", "r")
    until(lambda: not np.array_equal(frames[-1].picture, before), "r")
    on_screen(viewer)
    whole = frames[-1].picture
    choose(page, "nothing", "photo")
    until(lambda: not np.array_equal(frames[-1].picture, whole), "a split")
    split, half = frames[-1].picture, whole.shape[1] // 2
    np.testing.assert_array_equal(split[:, : half - 2], whole[:, : half - 2])
    assert split[:, half + 2 :].mean() < whole[:, half + 2 :].mean()  # a dark photo


def test_keyframes_become_a_path_that_render_py_reads(viewer):
    page, frames = viewer.page, viewer.frames
    page.get_by_role("tab", name="Path").click()
    page.get_by_role("button", name="Save for render.py").click()
    until(lambda: "at least 2 keyframes" in page.inner_text("body"), "a message")
    for start in (300, 340):
        page.get_by_role("button", name="Add keyframe here").click()
        number = frames[-1].number
        page.mouse.move(start, 300)
        page.mouse.down()
        page.mouse.move(start + 30, 300, steps=5)
        page.mouse.up()
        settle(frames, number)
    until(lambda: "2 keyframes" in page.inner_text("body"), "2 keyframes")
    page.get_by_role("button", name="Save for render.py").click()
    file = viewer.run.folder / "view" / "path.json"
    until(file.is_file, "a saved path")
    poses = paths.from_json(file)
    assert len(poses) == 3  # Render.frames
    assert np.linalg.norm(poses[0, :, 3] - poses[-1, :, 3]) > 0.0


def test_another_page_has_its_own_camera_and_light(viewer, browser):
    frames = viewer.frames
    mine = frames[-1].picture
    other = browser.new_page(viewport={"width": 700, "height": 420})
    before = len(frames)
    other.goto(viewer.server.address)
    until(lambda: len(frames) > before and frames[-1].finished, "the other's picture")
    assert frames[-1].picture.shape != mine.shape
    assert frames[-1].number <= 4
    other.close()
    viewer.page.get_by_role("tab", name="Light").click()
    choose(viewer.page, "r", "dark")
    until(lambda: frames[-1].picture.shape == mine.shape, "the first page at work")


def test_newer_checkpoints_are_shown_as_training_goes_on(viewer):
    arguments = flags(viewer.run.scene, viewer.run.folder, "Train.max_steps = 9")
    assert train_script.main(arguments) == 0
    until(lambda: viewer.frames[-1].step == 9, "the newer checkpoint")


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
