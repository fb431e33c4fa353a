# SPDX-License-Identifier: Apache-2.0
"""The pages as a person uses them, in a real headless Chromium.

What the live viewer draws is compared with what render.py writes for the same camera
and light. All tests share a browser, a viewer and its first page.
"""

import csv
import dataclasses
import json
import shutil
import types

import jax
import numpy as np
import pytest

import eval as eval_script
import render as render_script
import study as study_script
from internal import parallel
from internal.color import from_uint16, to_uint8
from internal.configs import load_config
from internal.files import image_io
from internal.rendering import paths
from internal.rendering.evidence import LEGEND
from internal.study.answers import preferences, read_answers
from internal.training.checkpoints import Checkpoints, load_trained
from internal.viewer.canvas import LINE_GREY
from internal.viewer.free_camera import PIXELS
from tests.browser import WITHOUT_WEBGL, chromium, launched, until
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
    for told in ("drag to turn", "nearest photo", "frames/s", "the lit scene"):
        until(lambda told=told: told in viewer.page.inner_text("body"), told)
    until(lambda: looks_like(viewer.drawn(), viewer.frame / 255.0), "a drawn picture")


def test_every_step_draws_what_render_py_writes(viewer, run):
    start = viewer.cameras[-1].camtoworld
    viewer.drag((300, 300), (330, 310))
    until(lambda: np.abs(viewer.cameras[-1].camtoworld - start).max() > 0.01, "a move")
    viewer.settle()
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


def test_a_click_on_something_gray_turns_the_light_and_is_undone(viewer):
    viewer.stand_at(viewer.studio.scene.view_names[0])
    viewer.start_over()
    before = viewer.control("For gin").input_value()
    viewer.press("Pick something gray")
    row, column = np.unravel_index(np.ptp(viewer.frame, axis=2).argmin(), (32, 36))
    viewer.page.mouse.click(16 * int(column) + 8, 16 * int(row) + 8)
    viewer.page.get_by_role("button", name="Undo the pick").wait_for()
    until(lambda: np.ptp(viewer.frame[row, column].astype(int)) <= 2, "a gray pixel")
    until(lambda: viewer.control("For gin").input_value() != before, "its bindings")
    viewer.press("Undo the pick")
    until(lambda: viewer.control("For gin").input_value() == before, "the light before")


def test_a_drag_turns_gently_about_what_is_in_the_middle(viewer):
    viewer.stand_at(viewer.studio.scene.view_names[0])
    viewer.start_over()
    before, middle = viewer.cameras[-1].camtoworld, viewer.frames[-1].middle
    ahead = np.linalg.norm(middle - before[:, 3])
    until(lambda: abs(viewer.reach() / ahead - 1.0) < 0.02, "what is turned about")
    viewer.drag((200, 256), (360, 256))
    until(lambda: np.abs(viewer.cameras[-1].camtoworld - before).max() > 0.1, "a move")
    viewer.settle()
    after = viewer.cameras[-1].camtoworld
    turned = np.degrees(np.arccos(after[:, 2] @ before[:, 2]))
    assert 15.0 < turned < 40.0
    ahead = middle - after[:, 3]
    np.testing.assert_allclose(ahead / np.linalg.norm(ahead), -after[:, 2], atol=0.02)


def test_a_double_click_looks_there_and_the_nearest_photo_is_named(viewer):
    name = viewer.studio.scene.view_names[1]
    viewer.stand_at(name)
    viewer.start_over()
    viewer.page.get_by_text(f"nearest photo: {name}").wait_for()
    before = viewer.cameras[-1].camtoworld
    viewer.page.mouse.dblclick(400, 160)
    until(lambda: np.abs(viewer.cameras[-1].camtoworld - before).max() > 0.02, "a turn")
    after = viewer.cameras[-1]
    np.testing.assert_allclose(after.camtoworld[:, 3], before[:, 3], atol=1e-3)
    half = np.tan(after.fov / 2.0)
    ray = before[:, :3] @ [(400 - 288) / 256 * half, (256 - 160) / 256 * half, -1.0]
    cosine = -after.camtoworld[:, 2] @ ray / np.linalg.norm(ray)
    assert np.degrees(np.arccos(cosine)) < 3.0


@pytest.mark.parametrize(
    ("key", "way"),
    [("w", [0, 0, -1]), ("s", [0, 0, 1]), ("a", [-1, 0, 0]), ("d", [1, 0, 0])],
)
def test_keys_walk_on_the_level_where_the_camera_looks(viewer, key, way):
    viewer.start_over()
    viewer.page.mouse.click(300, 300)  # keys go to the picture
    before = viewer.cameras[-1].camtoworld
    viewer.page.keyboard.down(key)
    until(lambda: apart(viewer, before) > 0.02, "a walk")
    viewer.page.keyboard.up(key)
    viewer.settle()
    went = (viewer.cameras[-1].camtoworld[:, 3] - before[:, 3]) @ before[:, :3]
    assert went @ way > 0.9 * np.linalg.norm(went)


def apart(viewer, before):
    """How far the camera has gone from a pose."""
    return np.linalg.norm(viewer.cameras[-1].camtoworld[:, 3] - before[:, 3])


def test_a_phone_turns_by_one_finger_moves_by_two_and_keeps_proportions(
    viewer, monkeypatch
):
    monkeypatch.setitem(PIXELS, "500 x 375", 36 * 32)  # a finished picture at once
    since = len(viewer.cameras)
    context = viewer.browser.new_context(
        viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True
    )
    phone = context.new_page()
    phone.goto(viewer.server.address)
    until(lambda: len(viewer.cameras) > since, "the phone's camera")
    canvas = phone.locator("canvas").first
    canvas.wait_for()
    box = canvas.bounding_box()

    def aspect():
        return viewer.frames[-1].camera.aspect

    until(lambda: abs(aspect() - box["width"] / box["height"]) < 0.02, "its window")
    height, width, _ = viewer.frames[-1].picture.shape
    assert abs(width / height - aspect()) < 0.1
    fingers = context.new_cdp_session(phone)
    before = viewer.cameras[-1].camtoworld
    swipe(fingers, [(200, 200)], (60, 0))
    until(lambda: turned(viewer, before) > 2.0, "a turn")
    viewer.settle()
    before = viewer.cameras[-1].camtoworld
    swipe(fingers, [(150, 200), (250, 200)], (0, 60))
    until(lambda: apart(viewer, before) > 0.01, "a move")
    viewer.settle()
    assert turned(viewer, before) < 1.0
    context.close()


def swipe(fingers, places, way):
    """Moves fingers from some places of a phone's screen."""
    for share in np.linspace(0.0, 1.0, 8):
        points = [
            {"x": x + share * way[0], "y": y + share * way[1], "id": number}
            for number, (x, y) in enumerate(places)
        ]
        kind = "touchMove" if share else "touchStart"
        fingers.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    fingers.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})


def turned(viewer, before):
    """By how many degrees the camera looks elsewhere."""
    cosine = viewer.cameras[-1].camtoworld[:, 2] @ before[:, 2]
    return np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))


def test_evidence_is_shown_with_its_legend(viewer):
    viewer.choose("Picture", "evidence")
    colors = {tuple(band.rgb) for band in LEGEND}

    def only_its_colors():
        return {tuple(c) for c in viewer.frame.reshape(-1, 3).tolist()} <= colors

    until(only_its_colors, "the false colours")
    viewer.page.get_by_text(LEGEND[0].meaning).wait_for()
    viewer.choose("Picture", "enhanced")
    viewer.page.get_by_text(LEGEND[0].meaning).wait_for(state="hidden")


def test_the_border_between_two_outputs_is_dragged_in_the_picture(viewer):
    whole = viewer.frame
    viewer.choose("Beside it", "dark")

    def border():
        """The column that is the line's grey from top to bottom, or -1."""
        grey = (viewer.frame == to_uint8(np.full(3, LINE_GREY))).all(axis=(0, 2))
        return int(np.flatnonzero(grey)[-1]) if grey.any() else -1

    until(lambda: border() == 17, "a border in the middle")
    np.testing.assert_array_equal(viewer.frame[:, :17], whole[:, :17])
    assert not np.array_equal(viewer.frame[:, 18:], whole[:, 18:])
    viewer.settle()
    computed = viewer.frames[-1].number
    viewer.drag((288, 256), (144, 256))
    until(lambda: border() == 8, "a border at a quarter")
    assert viewer.frames[-1].number == computed  # the camera stayed
    split = viewer.control("Split")
    until(lambda: abs(float(split.input_value()) - 0.25) < 0.02, "the slider to follow")


def test_a_click_on_a_photo_goes_there_and_compares(viewer):
    studio, page = viewer.studio, viewer.page
    viewer.stand_at(studio.scene.view_names[0])
    viewer.start_over()
    viewer.open_tab("Photos")
    page.get_by_label("Show photos").check()
    page.mouse.move(288, 256)

    def stepped_back():
        page.mouse.wheel(0, 200)
        return on_screen(viewer)

    until(stepped_back, "a photo in sight")
    viewer.settle()
    page.mouse.click(*on_screen(viewer)[0])
    places = np.asarray(studio.scene.cameras.camtoworlds)

    def there():
        apart = np.abs(places - viewer.cameras[-1].camtoworld).max(axis=(1, 2))
        return np.flatnonzero(apart < 1e-3)

    until(lambda: len(there()), "the camera at a photo's place")
    viewer.settle()
    photo = from_uint16(studio.scene.images[there()[0]])
    # At the photo's edge the window may see past it.
    right = slice(1, -1), slice(20, -1)
    np.testing.assert_allclose(viewer.frame[right] / 255.0, photo[right], atol=ROUNDING)
    viewer.open_tab("Photos")
    page.get_by_label("Show photos").uncheck()


def on_screen(viewer):
    """Where the window shows photos that can be clicked, in screen pixels."""
    camera, found = viewer.cameras[-1], []
    rotation, centre = camera.camtoworld[:, :3], camera.camtoworld[:, 3]
    size = 0.1 * viewer.studio.spread()
    for pose in np.asarray(viewer.studio.scene.cameras.camtoworlds):
        x, y, z = (pose[:, 3] - size * pose[:, 2] - centre) @ rotation
        scale = 256.0 / np.tan(camera.fov / 2.0) / max(-z, 1e-9)
        place = 288.0 + scale * x, 256.0 - scale * y
        near = np.linalg.norm(pose[:, 3] - centre) < 4.0 * size
        if not near and z < 0.0 and 60 < place[0] < 500 and 60 < place[1] < 450:
            found.append(place)
    return found


def test_a_path_is_previewed_saved_and_rendered(viewer, run):
    page, names = viewer.page, viewer.studio.scene.view_names
    viewer.open_tab("Path")
    viewer.press("Save for render.py")
    until(lambda: "at least 2 keyframes" in page.inner_text("body"), "a message")
    keyframes = []
    for name in (names[0], names[3]):
        viewer.stand_at(name)
        keyframes.append(viewer.cameras[-1].camtoworld[:, 3])
        viewer.open_tab("Path")
        viewer.press("Add keyframe here")
    until(lambda: "2 keyframes" in page.inner_text("body"), "2 keyframes")
    viewer.type_in("Frames", "5")

    before = len(viewer.cameras)
    viewer.press("Preview / stop")
    until(lambda: passed(viewer, before, keyframes[0]), "the preview's start")
    until(lambda: passed(viewer, before, keyframes[1]), "the preview's end")
    between = [camera.camtoworld[:, 3] for camera in viewer.cameras[before:]]
    middle = np.mean(keyframes, axis=0)
    apart = np.linalg.norm(np.subtract(between, middle), axis=1).min()
    assert apart < 0.4 * np.linalg.norm(keyframes[1] - keyframes[0])

    viewer.press("Save for render.py")
    file = viewer.folder / "path.json"
    until(file.is_file, "a saved path")
    assert len(paths.read_poses(file)) == 5
    viewer.settle()
    viewer.open_tab("Light")
    viewer.choose("Beside it", "nothing")
    assert_shown(viewer, rendered(run, file) / "enhanced" / "0004.png")


def passed(viewer, since, place):
    """Whether the camera was at a place since its ``since``-th move."""
    return any(
        np.abs(camera.camtoworld[:, 3] - place).max() < 1e-3
        for camera in viewer.cameras[since:]
    )


def test_another_page_has_its_own_camera_and_light_and_may_be_closed(viewer):
    frames = viewer.frames
    mine, before = viewer.frame, len(viewer.frames)
    other = viewer.browser.new_page(viewport={"width": 700, "height": 420})
    other.goto(viewer.server.address)
    until(lambda: len(frames) > before, "the other's picture")
    assert any(frame.number == 1 for frame in frames[before:])
    other.close()  # in the middle of refining
    viewer.choose("Picture", "dark")
    until(lambda: viewer.frame.shape == mine.shape, "the first page at work")


def test_without_webgl_a_page_says_so_and_others_go_on(viewer):
    browser = launched(viewer.browser.browser_type, WITHOUT_WEBGL)
    page = browser.new_page()
    page.goto(viewer.server.address)
    page.get_by_text("WebGL is unavailable").wait_for()
    frames = len(viewer.frames)
    viewer.choose("Picture", "dark")
    until(lambda: len(viewer.frames) > frames, "a picture where there is WebGL")
    browser.close()


def test_no_page_waited_for_a_compilation(viewer):
    assert viewer.compiled() == viewer.compiled_at_first


def test_newer_checkpoints_are_shown_as_training_goes_on(viewer, run):
    own = f"Config.checkpoint_dir = {str(run.folder)!r}"
    config = load_config([], [*bindings(run.scene), own])
    _, state = load_trained(config, parallel.data_mesh(jax.device_count()))
    with Checkpoints(run.folder, kept=3) as checkpoints:
        checkpoints.save(dataclasses.replace(state, step=state.step + 3))
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
    rows = csv.DictReader(file.read_text().splitlines())
    assert [row["answer"] for row in rows] == ["A", "undecided"]
    (result,) = preferences(read_answers([file]))
    assert (result.rival, result.a_better) == ("theirs", 0.5)
