# SPDX-License-Identifier: Apache-2.0
"""Laws of the live viewer behind its page: cameras, sharing, refinement, light.

A fake studio renders constant pictures, so nothing compiles; the page itself is in
test_browser.py.
"""

import asyncio
import contextlib
import dataclasses
import gc
import json
import threading
import types

import jax
import jax.numpy as jnp
import msgspec
import numpy as np
import pytest
import viser
import websockets.sync.client
import zstandard
from hypothesis import given
from hypothesis import strategies as st
from viser import _messages
from viser.infra import ClientId

from internal.cameras import Lens
from internal.configs import Config, ModelConfig, load_config
from internal.coord import Unbounded
from internal.enhancements.gamma import Gamma, GammaLit
from internal.enhancements.look import Look
from internal.enhancements.tone import Curve, tone_map
from internal.errors import UserError
from internal.files import image_io
from internal.rendering import paths
from internal.rendering.evidence import EVIDENCE, LEGEND
from internal.rendering.pictures import display_for, outputs_of
from internal.scene.colmap import lens_directions
from internal.scene.config import SceneConfig
from internal.scene.scene import Scene, load_scene
from internal.structs import LitRendering
from internal.viewer import takes
from internal.viewer.canvas import PHOTO, Split, compose, photo_through
from internal.viewer.chunked_jobs import Runnable, Series, Speedometer, Task
from internal.viewer.free_camera import PIXELS, FreeCamera, single_camera, vertical_fov
from internal.viewer.gate import Gate, fits
from internal.viewer.inquiry import Inquiry
from internal.viewer.panel import is_double
from internal.viewer.server import Server
from internal.viewer.session import Session
from internal.viewer.sharing import Turns
from internal.viewer.studio import Studio, with_fewer_samples
from internal.viewer.trained import Trained
from internal.viewer.white_point import make_gray
from tests.browser import until
from tests.scene_writers import facing_world, write_blender

POSE = np.eye(4)[:3]
CAMERA = FreeCamera(POSE, 0.8, 4 / 3)
CHUNK = 4000
NOWHERE = 9.0


def rendering(count: int, level: float = 0.5) -> LitRendering:
    one, three = jnp.full((count, 1), level), jnp.full((count, 3), level)
    lit = GammaLit(three, v_enhanced=three, alpha=one, gamma=three, gamma_energy=one)
    return LitRendering(rgb=three / 10, depth=one, v=one, r=three, lit=lit)


DISPLAY = display_for(ModelConfig(), rendering(9))


def parts_of(camera, level=0.5):
    pixels = int(camera.widths[0] * camera.heights[0])
    for _ in range(0, pixels, CHUNK):
        yield rendering(CHUNK, level)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    folder = write_blender(tmp_path_factory.mktemp("scene"), facing_world())
    return load_scene(SceneConfig(str(folder), near=2.0, far=8.0), "train")


class FixedSpeed(Speedometer):
    """A computer of known speed, whatever this one is busy with."""

    def note(self, rays, seconds):
        pass


class FakeStudio(Studio):
    """Renders constant pictures, and remembers the edits it was asked for."""

    def __init__(self, scene: Scene):
        self.scene, self.turns = scene, Turns()
        self.draft_speed = self.final_speed = FixedSpeed(1.0)
        self._config = Config()
        self.trained, self.outputs = Trained({}, 7, DISPLAY), outputs_of(ModelConfig())
        network = Gamma().network("enhancement")
        self._renderer = types.SimpleNamespace(
            relit=lambda _, rendering, edit: dataclasses.replace(
                rendering, lit=network.relight(rendering, edit)
            )
        )
        self.inquiry = Inquiry(self, factor=1)
        self.edits, self.drafts = [], 0

    def final(self, trained, camera, edit):
        self.edits.append(edit)
        if camera.camtoworlds[0, 0, 3] == NOWHERE:
            raise ValueError("no such place")
        return Task(camera, parts_of(camera), self.final_speed)

    def draft(self, trained, camera, edit):
        self.drafts += 1
        return self.final(trained, camera, edit)

    def focus_depth(self):
        return 4.0

    def update(self):
        return False


@pytest.fixture
def studio(scene):
    return FakeStudio(scene)


@pytest.fixture
def page(studio):
    """A session and what its browser was sent."""
    frames, messages = [], []
    session = Session(studio, frames.append, messages.append)
    studio.turns.join(session)
    return types.SimpleNamespace(session=session, frames=frames, messages=messages)


def work(studio):
    while studio.turns.take_one():
        pass


@given(st.floats(0.1, 10.0), st.sampled_from(sorted(PIXELS.values())))
def test_a_window_of_any_shape_fits_its_number_of_pixels(aspect, pixels):
    lens = FreeCamera(POSE, 0.8, aspect).lens(pixels)
    assert lens.width * lens.height <= pixels
    assert lens.width * lens.height > 0.8 * pixels
    assert vertical_fov(lens) == pytest.approx(0.8)


@given(st.floats(0.3, 4.0), st.integers(40, 4000))
def test_a_picture_of_any_size_shows_what_its_window_does(aspect, pixels):
    lens = FreeCamera(POSE, 0.8, aspect).lens(pixels)
    fx, fy, _, _ = lens.params
    half = np.tan(0.4)
    np.testing.assert_allclose([lens.width / fx, lens.height / fy],
                               [2 * half * aspect, 2 * half])  # fmt: skip


@pytest.mark.parametrize("aspect", [0.5, 4 / 3, 3.0])
def test_a_window_of_any_shape_holds_a_whole_photo(aspect):
    window = CAMERA.seen_in(aspect)
    up, across = np.tan(window.fov / 2), np.tan(window.fov / 2) * aspect
    photo = np.tan(CAMERA.fov / 2)
    assert up >= 0.999 * photo and across >= 0.999 * photo * CAMERA.aspect
    assert min(up / photo, across / photo / CAMERA.aspect) == pytest.approx(1.0)


def test_a_camera_that_stays_computes_nothing_anew(studio, page):
    page.session.stand(CAMERA)
    work(studio)
    shown = len(page.frames)
    page.session.stand(dataclasses.replace(CAMERA, camtoworld=POSE + 1e-7))
    work(studio)
    assert len(page.frames) == shown


def test_a_frame_knows_what_is_in_its_middle(studio, page):
    near, far = np.asarray([0.1, 8.0], np.float32)
    studio.scene = dataclasses.replace(studio.scene, space=Unbounded(near, far))
    place = POSE + np.array([0.0, 0, 0, 3.0])
    page.session.stand(dataclasses.replace(CAMERA, camtoworld=place))
    work(studio)
    expected = place[:, 3] - 0.5 * place[:, 2]  # the fake's depth
    # On the axis to the bit: to look there must not turn the camera.
    np.testing.assert_allclose(page.frames[-1].middle, expected, atol=1e-9)


def test_what_photos_show_is_photographed_and_what_is_behind_them_not(studio, page):
    camera = studio.view_camera(0)
    page.session.stand(camera)
    work(studio)
    assert page.session.photographed() > 0.9
    back = camera.camtoworld * [-1.0, 1.0, -1.0, 1.0]
    page.session.stand(dataclasses.replace(camera, camtoworld=back))
    work(studio)
    assert page.session.photographed() == 0.0


def test_two_clicks_are_one_only_at_once_and_at_one_place():
    first = (1.0, (0.5, 0.5))
    assert is_double(first, (1.2, (0.5, 0.51)))
    assert not is_double(first, (2.0, (0.5, 0.5)))
    assert not is_double(first, (1.2, (0.5, 0.6)))


def test_cameras_of_all_sizes_share_one_compiled_program():
    shapes = {
        single_camera(POSE, CAMERA.lens(pixels)).directions.shape
        for pixels in PIXELS.values()
    }
    assert len(shapes) == 1


def test_a_still_camera_gets_finer_pictures_up_to_the_wanted_size(studio, page):
    page.session.stand(CAMERA)
    work(studio)
    sizes = [frame.picture.shape[0] * frame.picture.shape[1] for frame in page.frames]
    assert sizes == sorted(sizes) and len(sizes) == 5
    assert 0.9 * PIXELS["500 x 375"] < sizes[-1] <= PIXELS["500 x 375"]
    assert [frame.finished for frame in page.frames] == [False] * 4 + [True]
    assert [frame.number for frame in page.frames] == [1, 2, 3, 4, 5]
    assert studio.drafts == 4


def test_a_fast_computer_starts_with_a_large_picture(studio, page):
    studio.final_speed = FixedSpeed(1e9)
    page.session.stand(CAMERA)
    work(studio)
    assert len(page.frames) == 1
    assert not studio.drafts


def test_a_draft_looks_at_the_same_field_less_often():
    whole = ModelConfig(num_samples=(64, 1))
    draft = with_fewer_samples(whole)
    assert draft.config.num_samples == (32, 1)
    same = dataclasses.replace(draft.config, num_samples=(64, 1))
    assert same == whole


def test_a_moving_camera_sees_pictures_and_refines_none(studio, page):
    for step in range(20):
        pose = POSE + 0.01 * step
        page.session.stand(dataclasses.replace(CAMERA, camtoworld=pose))
        studio.turns.take_one()
        studio.turns.take_one()
    assert len(page.frames) >= 9
    assert {frame.picture.shape for frame in page.frames} == {(38, 50, 3)}


def test_exposure_and_colour_render_nothing_and_contrast_does(studio, page):
    page.session.stand(CAMERA)
    work(studio)
    rendered = len(studio.edits)
    page.session.light(Look(exposure=1.0, temperature=3000.0, tint=0.2))
    work(studio)
    assert len(studio.edits) == rendered
    gains = Look(1.0, 1.0, 3000.0, 0.2).edit().coded_gains
    expected = np.round(np.clip(0.5 * gains, 0, 1) * 255)
    np.testing.assert_allclose(page.frames[-1].picture[0, 0], expected, atol=1)
    page.session.light(Look(contrast=2.0))
    work(studio)
    assert len(studio.edits) > rendered
    np.testing.assert_array_equal(studio.edits[-1].contrast, 2.0)
    np.testing.assert_array_equal(studio.edits[-1].gains, np.ones(3))


COLOURS = [(0.6, 0.5, 0.45), (0.2, 0.3, 0.4), (0.05, 0.05, 0.04)]


def tone_pixel(dark, look):
    curve = Curve(3.0, jnp.asarray(1.4), 1.3, 1.5)
    return tone_map(np.array(dark) / 4, curve, look.edit())


def gamma_pixel(dark, look):
    return np.array(dark) * look.edit().coded_gains


@pytest.mark.parametrize("dark", COLOURS)
@pytest.mark.parametrize("shown", [tone_pixel, gamma_pixel])
def test_what_is_picked_becomes_gray_and_the_rest_of_the_look_stays(shown, dark):
    look = Look(strength=0.8, exposure=0.5, temperature=5000.0, tint=0.3, contrast=1.2)
    solved = make_gray(lambda look: np.asarray(shown(dark, look)), look)
    red, green, blue = np.asarray(shown(dark, solved))
    assert max(abs(red - green), abs(blue - green)) < 0.01 * green
    rest = dataclasses.replace(solved, temperature=look.temperature, tint=look.tint)
    assert rest == look


def test_what_no_light_makes_gray_is_refused():
    for dark, reason in (((0.0, 0.9, 0.0), "its own"), ((0.0,) * 3, "black")):
        with pytest.raises(UserError, match=reason):
            make_gray(lambda look, dark=dark: gamma_pixel(dark, look), Look())


def test_a_pick_undoes_the_light_that_turned_a_gray_picture(studio, page):
    page.session.stand(CAMERA)
    page.session.light(Look(temperature=3000.0, tint=0.4, exposure=-1.0))
    work(studio)
    red, _, blue = page.frames[-1].picture[5, 5].astype(int)
    assert red > blue + 50
    page.session.light(page.session.white_point((1.0, 0.5)))
    work(studio)
    assert np.ptp(page.frames[-1].picture[5, 5].astype(int)) <= 1
    assert page.session.look.exposure == -1.0


def test_a_split_shows_one_output_on_each_side():
    picture = jax_like(rendering(40 * 30), 30, 40)
    photo = np.ones((30, 40, 3), np.float32)
    choice = Split("enhanced", "dark", 0.25)
    drawn = compose(picture, DISPLAY, choice, {})
    assert (drawn[:, :9] == 128).all()  # 0.5
    assert (drawn[:, 10:] == 13).all()  # 0.05
    whole = compose(picture, DISPLAY, Split(PHOTO), {PHOTO: photo})
    assert (whole == 255).all()


def test_evidence_is_asked_for_once_by_whoever_wants_it_and_then_shown(studio, page):
    page.session.stand(CAMERA)
    work(studio)
    rendered = len(studio.edits)
    page.session.choose(Split(EVIDENCE))
    studio.turns.take_one()
    assert (page.frames[-1].picture == 13).all()  # dark, 0.05
    work(studio)
    photos = len(studio.scene.view_names)
    assert len(studio.edits) == rendered + photos
    colors = {tuple(band.rgb) for band in LEGEND}
    assert {tuple(c) for c in page.frames[-1].picture.reshape(-1, 3)} <= colors
    assert len(page.messages) == 1 and "asking" in page.messages[0]
    page.session.choose(Split("dark", EVIDENCE))
    work(studio)
    assert len(studio.edits) == rendered + photos


def test_a_snapshot_of_evidence_shows_its_colours(studio, page, tmp_path):
    page.session.stand(CAMERA)
    page.session.choose(Split(EVIDENCE))
    work(studio)
    page.session.snapshot(tmp_path)
    work(studio)
    picture = image_io.read_srgb(tmp_path / "snapshot_001.png") * 255
    colors = {tuple(band.rgb) for band in LEGEND}
    assert {tuple(c) for c in np.round(picture).reshape(-1, 3)} <= colors


def test_rays_without_a_colour_are_black():
    picture = jax_like(rendering(12, np.nan), 3, 4)
    drawn = compose(picture, DISPLAY, Split(), {})
    assert (drawn == 0).all()


def jax_like(flat, height, width):
    return jax.tree.map(lambda x: jnp.reshape(x, (height, width, -1)), flat)


def test_a_photo_through_its_own_lens_is_the_photo():
    lens = Lens("PINHOLE", 24, 18, (20.0, 20.0, 12.0, 9.0))
    photo = np.random.default_rng(0).random((18, 24, 3)).astype(np.float32)
    directions = lens_directions(lens)
    seen = photo_through(photo, lens, np.eye(3), directions, lens)
    np.testing.assert_array_equal(seen, photo)


def test_a_photo_in_a_wider_window_has_black_beside_it():
    lens = Lens("PINHOLE", 24, 18, (20.0, 20.0, 12.0, 9.0))
    window = Lens("PINHOLE", 48, 18, (20.0, 20.0, 24.0, 9.0))
    photo = np.ones((18, 24, 3), np.float32)
    seen = photo_through(photo, lens, np.eye(3), lens_directions(window), window)
    assert (seen[:, 12:36] == 1.0).all()
    assert (seen[:, :12] == 0.0).all() and (seen[:, 36:] == 0.0).all()


@dataclasses.dataclass(frozen=True)
class Logged(Runnable):
    """Work that notes its name at every step."""

    log: list[str]
    name: str
    how_urgent: int

    def urgency(self) -> int:
        return self.how_urgent

    def step(self) -> None:
        self.log.append(self.name)

    def failed(self, error: Exception) -> None:
        raise error


def test_sessions_with_work_take_turns_and_a_first_picture_goes_before(studio):
    log = []

    turns = Turns()
    for name, urgency in (("a", 1), ("idle", 0), ("b", 1)):
        turns.join(Logged(log, name, urgency))
    for _ in range(4):
        turns.take_one()
    assert log == ["a", "b", "a", "b"]
    turns.join(Logged(log, "first", 2))
    turns.take_one()
    assert log[-1] == "first"


def test_an_error_reaches_its_own_page_and_no_other(studio, page):
    frames, messages = [], []
    broken = Session(studio, frames.append, messages.append)
    studio.turns.join(broken)
    far = POSE.copy()
    far[0, 3] = NOWHERE
    broken.stand(dataclasses.replace(CAMERA, camtoworld=far))
    page.session.stand(CAMERA)
    work(studio)
    assert messages == ["no such place"]
    assert page.messages == [] and page.frames[-1].finished
    broken.stand(CAMERA)
    work(studio)
    assert frames[-1].finished


def test_a_page_that_left_gets_no_more_work(studio, page):
    page.session.stand(CAMERA)
    studio.turns.leave(page.session)
    assert not studio.turns.take_one()


def test_a_job_may_be_stepped_at_any_pace():
    done = []
    cameras = [single_camera(POSE, CAMERA.lens(9000)) for _ in range(2)]
    speed = Speedometer(1.0)
    job = Series([Task(c, parts_of(c), speed) for c in cameras], done.append)
    steps = 0
    while not job.done:
        job.step()
        steps += 1
    assert len(done) == job.delivered == 2
    assert steps == 2 * (3 + 1)  # 9000 pixels are 3 chunks, then it is handed over


def test_a_snapshot_is_a_picture_and_a_path_of_one_pose(studio, page, tmp_path):
    scene = studio.scene
    page.session.stand(CAMERA)
    page.session.light(Look(exposure=-1.0))
    work(studio)
    for _ in range(2):
        page.session.snapshot(tmp_path)
        work(studio)
    first, second = sorted(tmp_path.glob("snapshot_*.json"))
    assert first.with_suffix(".png").is_file() and second.with_suffix(".png").is_file()
    facts = json.loads(first.read_text())
    assert "Render.exposure = -1.0" in facts["gin_bindings"]
    assert (facts["output"], facts["step"]) == ("enhanced", 7)
    world = paths.read_poses(first)
    np.testing.assert_allclose(world, takes.in_world(scene, POSE[None]), atol=1e-6)
    np.testing.assert_array_equal(
        studio.edits[-1].gains, Look(exposure=-1.0).edit().gains
    )


def test_a_snapshot_is_written_though_its_page_was_closed(studio, page, tmp_path):
    page.session.stand(CAMERA)
    work(studio)
    page.session.snapshot(tmp_path)
    studio.turns.take_one()
    studio.turns.leave(page.session)
    work(studio)
    assert image_io.read_srgb(tmp_path / "snapshot_001.png").size > 0


def test_a_snapshot_that_fails_says_so_and_ends(studio, page, tmp_path):
    blocked = tmp_path / "file"
    blocked.touch()
    page.session.stand(CAMERA)
    work(studio)
    page.session.snapshot(blocked)
    work(studio)
    assert len(page.messages) == 1 and str(blocked) in page.messages[0]
    assert not studio.turns.take_one()


def browser_message(**changes):
    """Where a browser says its camera is."""
    camera = dict(
        type="ViewerCameraMessage", wxyz=[1.0, 0, 0, 0], position=[0.0, 0, 0], fov=0.8,
        near=0.01, far=1000.0, image_height=150, image_width=200, look_at=[0.0, 0, 1],
        up_direction=[0.0, 1, 0],
    )  # fmt: skip
    return msgspec.msgpack.encode(camera | changes)


@pytest.fixture
def server(studio, tmp_path):
    config = load_config([], [f"Config.checkpoint_dir = {str(tmp_path)!r}"])
    running = Server(config, studio, "127.0.0.1", port=0)
    yield running
    running.close()


def message(kind, **fields):
    return msgspec.msgpack.encode({"type": kind, **fields})


@contextlib.contextmanager
def connected(server, **options):
    """A page of the viewer, without a browser."""
    protocol = websockets.Subprotocol(f"viser-v{viser.__version__}")
    address = server.address.replace("http", "ws")
    with (
        contextlib.suppress(websockets.ConnectionClosed),
        websockets.sync.client.connect(
            address, subprotocols=[protocol], max_size=None, **options
        ) as socket,
    ):
        yield socket


BROKEN = (
    b"no message",
    "text",
    message("NoSuchMessage"),
    message("GuiFormSubmitMessage"),
    message("SceneNodeClickMessage", name=[], owner=7),
    browser_message(wxyz=[0.0, 0, 0, 0]),
    browser_message(wxyz=["x"] * 4),
    browser_message(position=[np.nan] * 3),
    browser_message(position=[1e300, 0, 0]),
    browser_message(up_direction=[0.0]),
    browser_message(image_height=0),
    browser_message(fov=-1.0, image_width=10**9),
)


def test_broken_requests_end_nothing_and_print_no_traceback(
    studio, server, capfd, caplog
):
    with connected(server) as other:
        for place, broken in enumerate(BROKEN):
            with connected(server) as socket:
                socket.send(broken)  # before its page is opened, and after
                socket.send(browser_message())
                socket.send(broken)
                studio.edits.clear()
                other.send(browser_message(position=[0.1 * place, 0.0, 0.0]))
                until(lambda: studio.edits, "a picture for another")
    gc.collect()  # asyncio tells of a task's error when the task is forgotten
    printed = "".join(capfd.readouterr())
    assert "Traceback" not in printed and "rror:" not in printed
    assert "a page was sent away: " in printed
    assert not [record for record in caplog.records if record.exc_info]


def test_a_page_of_another_origin_is_sent_away(studio, server):
    def first_answer(origin):
        with connected(server, origin=websockets.Origin(origin)) as socket:
            socket.send(browser_message())
            return socket.recv(10.0)

    assert first_answer("http://elsewhere") is None
    assert first_answer(server.address) is not None


@pytest.mark.parametrize("ends", ["page", "server"])
def test_what_a_page_wanted_done_ends_with_it(studio, tmp_path, ends):
    config = load_config([], [f"Config.checkpoint_dir = {str(tmp_path)!r}"])
    server = Server(config, studio, "127.0.0.1", port=0)
    begun, ended = threading.Event(), threading.Event()

    async def take_long(_):
        begun.set()
        try:
            await asyncio.sleep(600.0)
        except asyncio.CancelledError:
            ended.set()
            raise

    with connected(server) as socket:
        socket.send(browser_message())
        until(lambda: server._pages, "a page")
        (client,) = server._server.get_clients().values()
        client.camera.on_update(take_long)
        socket.send(browser_message(position=[0.1, 0.0, 0.0]))
        until(begun.is_set, "something that takes long")
        if ends == "server":
            server.close()
    until(ended.is_set, "its end")
    if ends == "page":
        server.close()


def test_a_page_is_sent_its_first_picture_before_the_photos(server):
    with connected(server) as socket:
        socket.send(browser_message())
        sent = []
        while "CameraFrustumMessage" not in sent:
            sent += [m["type"] for m in messages_in(socket.recv(30.0))]
    assert sent.count("BackgroundImageMessage") >= 2  # the first one is empty


def messages_in(raw):
    """What a frame of the server's says."""
    size = int.from_bytes(raw[8:16], "little")
    inner = zstandard.ZstdDecompressor().decompress(raw[16 : 16 + size])
    return msgspec.msgpack.decode(inner)["messages"]


def test_a_control_takes_what_its_page_can_send(studio, server):
    wanted = {
        "Exposure": ([1, -4.0, 0.1], [4.1, -1e300, True, "1", [1.0], None]),
        "Frames": ([2, 9], [1, 10**9, "9", None]),
        "Pixels": (list(PIXELS), ["1 x 1", 0, ["200 x 150"], None]),
        "Show photos": ([False], [1, "no", None]),
        "Name": (["x", "../x"], [b"x", 5, None]),
        "Snapshot": ([True, None], []),
    }
    with connected(server) as socket:
        socket.send(browser_message())
        until(lambda: server._pages, "a page")
        (client,) = server._server.get_clients().values()
        handles = client.gui._gui_input_handle_from_uuid.values()
        controls = {handle.label: handle for handle in handles}
        for label, (good, bad) in wanted.items():
            assert all(fits(controls[label], value) for value in good), label
            assert not any(fits(controls[label], value) for value in bad), label
        assert not fits(None, True)

        # The same on the way of a message, and no other property at all.
        exposure = controls["Exposure"]
        own = {"uuid": exposure._impl.uuid}
        for update in ({"value": 1e300}, {"step": 9.0}, {"value": 1.0, "step": 9.0}):
            socket.send(message("GuiUpdateMessage", updates=update, **own))
        socket.send(message("GuiUpdateMessage", updates={"value": -2.0}, **own))
        until(lambda: exposure.value == -2.0, "the last value")
        assert exposure.step == 0.1
        assert all(-4.0 <= edit.gains[0] <= 1.0 for edit in studio.edits)


def test_no_message_puts_the_viewer_on_the_internet(server):
    asked = _messages.ShareUrlRequest()
    assert not Gate(server._server)._is_sound(ClientId(0), asked)


def test_a_path_is_saved_in_the_frame_of_the_pose_file(scene, tmp_path):
    poses = np.asarray(scene.cameras.camtoworlds, np.float64)
    path = takes.write_path(tmp_path, "walk", scene, poses, fps=30)
    again = paths.read_poses(path)
    np.testing.assert_allclose(again, takes.in_world(scene, poses), atol=1e-6)
    with pytest.raises(UserError, match=r"path name '\.\./x'"):
        takes.write_path(tmp_path, "../x", scene, poses, fps=30)
    with pytest.raises(UserError, match="no snapshot's name"):
        takes.write_path(tmp_path, "snapshot_001", scene, poses, fps=30)


def test_a_path_goes_through_its_keyframes(scene):
    keyframes = np.asarray(scene.cameras.camtoworlds, np.float64)[:3]
    path = paths.through(keyframes, 30)
    for keyframe, index in ((keyframes[0], 0), (keyframes[2], -1)):
        np.testing.assert_allclose(path[index], keyframe, atol=1e-6)
    nearest = np.abs(path - keyframes[1]).max(axis=(1, 2)).min()
    assert nearest < 0.05


def test_smoothing_shortens_a_zigzag_and_keeps_its_ends():
    zigzag = np.tile(POSE, (5, 1, 1))
    zigzag[:, 0, 3] = np.arange(5.0)
    zigzag[1::2, 1, 3] = 1.0
    smooth = takes.smoothed(zigzag)
    np.testing.assert_array_equal(smooth[[0, -1]], zigzag[[0, -1]])

    def length(poses):
        return np.linalg.norm(np.diff(poses[:, :, 3], axis=0), axis=-1).sum()

    assert length(smooth) < 0.8 * length(zigzag)
    np.testing.assert_allclose(smooth[1, :, 3], [1.0, 0.5, 0.0])  # (0 + 2 * 1 + 0) / 4
