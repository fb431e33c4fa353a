# SPDX-License-Identifier: Apache-2.0
"""Every format reads back what was written, and is told from the others."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from internal.cameras import Lens
from internal.errors import UserError
from internal.scene import readers
from tests.scene_writers import (
    LENS,
    World,
    edit_json,
    facing_world,
    frame_entries,
    llff_rows,
    random_rotation,
    write_blender,
    write_colmap,
    write_json,
    write_llff,
    write_model,
    write_nerfstudio,
    write_pictures,
)

WORLD = facing_world()
WRITERS = {
    "blender": write_blender,
    "nerfstudio": write_nerfstudio,
    "llff": write_llff,
    "colmap": write_colmap,
}
DISTORTION = {"k1": 0.1, "k2": -0.05, "p1": 0.001, "p2": -0.002}
every_format = pytest.mark.parametrize("name", WRITERS)


def read(folder: Path, loader: str = "auto", images_dir: str = "", pair_by="name"):
    return readers.read_files(folder, loader, images_dir, pair_by)


@every_format
def test_reads_what_was_written(tmp_path, name):
    WRITERS[name](tmp_path, WORLD)
    files = read(tmp_path)
    assert files.format == name
    assert list(files.names) == WORLD.names
    np.testing.assert_allclose(files.camtoworlds, WORLD.camtoworlds, atol=1e-9)
    folder = tmp_path / ("low" if name == "blender" else "images")
    assert files.image_paths == tuple(folder / n for n in files.names)
    lens = Lens("SIMPLE_PINHOLE", 24, 18, (20.0, 12.0, 9.0)) if name == "llff" else LENS
    assert set(files.lenses) == {lens}
    assert files.test_names == (frozenset({"00.png"}) if name == "blender" else None)
    assert all(path.exists() for path in files.pose_paths)
    assert len(files.points) == (len(WORLD.points) if name == "colmap" else 0)


def test_detection_prefers_the_more_specific_file(tmp_path):
    """Formats are added one by one, each winning over those before."""
    for name in reversed(WRITERS):
        WRITERS[name](tmp_path, WORLD)
        assert read(tmp_path).format == name


@every_format
def test_forced_format_wins_over_detection(tmp_path, name):
    for write in WRITERS.values():
        write(tmp_path, WORLD)
    assert read(tmp_path, name).format == name


@every_format
def test_images_dir_replaces_the_pictures_and_keeps_the_poses(tmp_path, name):
    WRITERS[name](tmp_path, WORLD)
    renamed = [n.upper().replace("PNG", "JPG") for n in WORLD.names]
    write_pictures(tmp_path / "enhanced/sci", renamed)
    files = read(tmp_path, images_dir="enhanced/sci")
    assert [path.name for path in files.image_paths] == renamed
    np.testing.assert_allclose(files.camtoworlds, WORLD.camtoworlds, atol=1e-9)


@pytest.mark.parametrize("name", [n for n in WRITERS if n != "llff"])
@pytest.mark.parametrize(
    ("start", "needed"), [("sci_", "number"), ("v2_", "order")], ids=["one", "two"]
)
def test_renamed_pictures_pair_only_as_the_user_allows(
    tmp_path, capsys, name, start, needed
):
    WRITERS[name](tmp_path, WORLD)
    renamed = [f"{start}{n}" for n in WORLD.names]
    write_pictures(tmp_path / "enhanced", renamed)
    with pytest.raises(UserError, match=r"enhanced: .*Config\.pair_by"):
        read(tmp_path, images_dir="enhanced")
    if needed == "order":
        with pytest.raises(UserError, match="cannot pair"):
            read(tmp_path, images_dir="enhanced", pair_by="number")
    files = read(tmp_path, images_dir="enhanced", pair_by=needed)
    assert [path.name for path in files.image_paths] == renamed
    rule = {"number": "equal numbers in the names", "order": "sorted order"}[needed]
    printed = capsys.readouterr().out
    assert f"by {rule}, as Config.pair_by allows: 00.png -> {renamed[0]}" in printed


@pytest.mark.parametrize("name", [n for n in WRITERS if n != "llff"])
def test_no_pose_takes_its_neighbours_picture(tmp_path, name):
    """One picture gone, one of another name in its place: never paired."""
    WRITERS[name](tmp_path, WORLD)
    write_pictures(tmp_path / "enhanced", [*WORLD.names[:2], "new.png"])
    write_pictures(tmp_path / "enhanced", WORLD.names[3:])
    for pair_by in ("name", "number"):
        if name == "colmap":
            files = read(tmp_path, images_dir="enhanced", pair_by=pair_by)
            assert [path.name for path in files.image_paths] == list(files.names)
            assert "02.png" not in files.names
        else:
            with pytest.raises(UserError, match=r"02\.png"):
                read(tmp_path, images_dir="enhanced", pair_by=pair_by)


def test_an_unknown_rule_of_pairing_is_named(tmp_path):
    write_nerfstudio(tmp_path, WORLD)
    with pytest.raises(UserError, match=r"pair_by = 'luck'.*name, number, order"):
        read(tmp_path, images_dir="images", pair_by="luck")


def test_rows_without_names_pair_by_order_and_it_is_printed(tmp_path, capsys):
    write_llff(tmp_path, WORLD)
    read(tmp_path)
    expected = (
        f"paired by order with the pictures of {tmp_path / 'images'}, from 00.png"
    )
    assert expected in capsys.readouterr().out


@pytest.mark.parametrize(
    "pattern, words", [("{}", ", as text: 1.png, 10.png"), ("{:02}", "")]
)
def test_the_order_of_text_is_shown_where_numbers_have_another(
    pattern, words, tmp_path, capsys
):
    world = facing_world(11)
    names = [f"{pattern.format(view)}.png" for view in range(1, 12)]
    write_pictures(tmp_path / "images", names)
    np.save(tmp_path / "poses_bounds.npy", llff_rows(world, (2.0, 7.0)))
    assert list(read(tmp_path).names) == sorted(names)
    said = capsys.readouterr().out
    assert "as text" in said if words else "as text" not in said
    assert words in said


@pytest.mark.parametrize(
    "listed",
    [
        "images/{n}.JPG",
        "./images/{n}",
        "images\\{n}.png",
        "IMAGES/../images/{n}.png",
        "/home/me/s/images/{n}.png",
    ],
)
def test_frames_pair_by_name_up_to_spelling(tmp_path, listed):
    """Frames come in reverse, so order would pair wrongly."""
    write_nerfstudio(tmp_path, WORLD)
    (tmp_path / "IMAGES").mkdir(exist_ok=True)
    edit_json(
        tmp_path / "transforms.json",
        lambda c: [
            f.update(file_path=listed.format(n=Path(f["file_path"]).stem))
            for f in c["frames"]
        ],
    )
    files = read(tmp_path)
    assert [path.name for path in files.image_paths] == WORLD.names
    np.testing.assert_allclose(files.camtoworlds, WORLD.camtoworlds, atol=1e-9)


def test_a_name_that_two_pictures_fit_is_refused(tmp_path):
    write_nerfstudio(tmp_path, WORLD)
    write_pictures(tmp_path / "images", ["03.jpg"])
    edit_json(
        tmp_path / "transforms.json",
        lambda c: c["frames"][2].update(file_path="images/03"),
    )
    with pytest.raises(UserError, match=r"03\.jpg and 03\.png could both be meant"):
        read(tmp_path)


def test_one_picture_with_two_poses_is_refused(tmp_path):
    write_nerfstudio(tmp_path, WORLD)
    path = tmp_path / "transforms.json"
    edit_json(path, lambda c: c["frames"][2].update(file_path="images/00.png"))
    with pytest.raises(UserError, match=r"00\.png is listed with two different poses"):
        read(tmp_path)


def test_unknown_format_lists_the_known(tmp_path):
    with pytest.raises(
        UserError, match="'nerf'; choose auto, blender, nerfstudio, llff, colmap"
    ):
        read(tmp_path, "nerf")


def test_missing_folder_is_named(tmp_path):
    with pytest.raises(UserError, match="scene folder not found"):
        read(tmp_path / "nowhere")


def test_no_match_says_what_was_looked_for_and_what_is_there(tmp_path):
    for i in range(10):
        (tmp_path / f"photo{i}.jpg").touch()
    (tmp_path / "notes").mkdir()
    with pytest.raises(UserError) as error:
        read(tmp_path)
    message = str(error.value)
    for looked_for in ("transforms_train.json", "transforms.json", "poses_bounds.npy"):
        assert looked_for in message
    assert "sparse/0" in message
    assert "notes/, photo0.jpg" in message and "and 3 more" in message


def test_forced_format_that_is_not_there_lists_only_its_own_files(tmp_path):
    write_colmap(tmp_path, WORLD)
    with pytest.raises(UserError, match=r"llff: poses_bounds.npy.*images/, sparse/$"):
        read(tmp_path, "llff")


class TestTransforms:
    def test_test_views_listed_bright_take_their_dark_twins(self, tmp_path):
        write_blender(tmp_path, WORLD, test=(1, 3))
        files = read(tmp_path)
        assert {path.parent.name for path in files.image_paths} == {"low"}
        assert files.test_names == {"01.png", "03.png"}

    def test_bright_listing_without_a_dark_folder_stays(self, tmp_path):
        write_blender(tmp_path, WORLD)
        (tmp_path / "low").rename(tmp_path / "night")
        for split in ("train", "test"):
            edit_json(
                tmp_path / f"transforms_{split}.json",
                lambda c: [
                    f.update(file_path=f["file_path"].replace("low", "night"))
                    for f in c["frames"]
                ],
            )
        folders = {path.parent.name for path in read(tmp_path).image_paths}
        assert folders == {"night", "high"}

    def test_view_listed_twice_is_held_out(self, tmp_path):
        write_blender(tmp_path, WORLD, test=(1,))
        entries = frame_entries(WORLD, "low")
        edit_json(
            tmp_path / "transforms_train.json", lambda c: c.update(frames=entries)
        )
        files = read(tmp_path)
        assert list(files.names) == WORLD.names
        assert files.test_names == {"01.png"}

    def test_val_stands_in_for_a_missing_test_file(self, tmp_path):
        write_blender(tmp_path, WORLD, test=(2, 4))
        (tmp_path / "transforms_test.json").unlink()
        files = read(tmp_path)
        assert files.test_names == {"02.png"}
        assert len(files.names) == len(WORLD.names) - 1

    def test_train_file_alone_states_no_split(self, tmp_path):
        write_blender(tmp_path, WORLD, test=())
        for split in ("val", "test"):
            (tmp_path / f"transforms_{split}.json").unlink()
        assert read(tmp_path).test_names is None

    def test_equal_file_names_in_two_folders_stay_apart(self, tmp_path):
        """Blender's own scenes: train/r_0 and test/r_0, without extension."""
        for split, folder in (("train", "./train"), ("test", "./test")):
            write_pictures(tmp_path / folder, WORLD.names)
            frames = frame_entries(WORLD, folder)
            for frame in frames:
                frame["file_path"] = frame["file_path"].removesuffix(".png")
            content = {"camera_angle_x": 0.9, "frames": frames}
            write_json(tmp_path / f"transforms_{split}.json", content)
        files = read(tmp_path)
        assert len(set(files.names)) == 2 * len(WORLD.names)
        assert files.names[0] == "test/00.png"
        assert files.test_names == {f"test/{name}" for name in WORLD.names}

    def test_field_of_view_alone_gives_square_pixels(self, tmp_path):
        """24 pixels over 90 degrees: f = 12; the size is the picture's own."""
        write_nerfstudio(tmp_path, WORLD)
        content = {
            "camera_angle_x": math.pi / 2,
            "frames": frame_entries(WORLD, "images"),
        }
        write_json(tmp_path / "transforms.json", content)
        (lens,) = set(read(tmp_path).lenses)
        assert (lens.model, lens.width, lens.height) == ("PINHOLE", 24, 18)
        np.testing.assert_allclose(lens.params, [12.0, 12.0, 12.0, 9.0])

    @pytest.mark.parametrize(
        ("extra", "model", "distortion"),
        [
            ({}, "PINHOLE", ()),
            (DISTORTION, "OPENCV", (0.1, -0.05, 0.001, -0.002)),
            (
                {**DISTORTION, "k3": 0.2},
                "FULL_OPENCV",
                (0.1, -0.05, 0.001, -0.002, 0.2, 0.0, 0.0, 0.0),
            ),
            (
                {"camera_model": "OPENCV_FISHEYE", "k1": 0.1, "k4": 0.3},
                "OPENCV_FISHEYE",
                (0.1, 0.0, 0.0, 0.3),
            ),
            ({"is_fisheye": True, "k1": 0.1}, "OPENCV_FISHEYE", (0.1, 0.0, 0.0, 0.0)),
            ({"camera_model": "SIMPLE_PINHOLE"}, "PINHOLE", ()),
        ],
    )
    def test_lens_models(self, tmp_path, extra, model, distortion):
        write_nerfstudio(tmp_path, WORLD, **extra)
        (lens,) = set(read(tmp_path).lenses)
        assert lens == Lens(model, 24, 18, LENS.params + distortion)

    def test_panorama(self, tmp_path):
        write_nerfstudio(tmp_path, WORLD, camera_model="EQUIRECTANGULAR")
        assert read(tmp_path).lenses[0] == Lens("EQUIRECTANGULAR", 24, 18, (24.0, 18.0))

    def test_frames_override_the_file(self, tmp_path):
        write_nerfstudio(tmp_path, WORLD)
        path = tmp_path / "transforms.json"
        edit_json(path, lambda c: c["frames"][-1].update(fl_x=30.0, k1=0.1))
        lenses = read(tmp_path).lenses
        assert lenses[0] == Lens(
            "OPENCV", 24, 18, (30.0, 20.0, 12.0, 9.0, 0.1, 0.0, 0.0, 0.0)
        )
        assert set(lenses[1:]) == {LENS}

    def test_filenames_are_the_split(self, tmp_path):
        listed = [f"images/{name}" for name in WORLD.names]
        split = {"train_filenames": listed[2:5], "test_filenames": listed[:1]}
        write_nerfstudio(tmp_path, WORLD, **split)
        files = read(tmp_path)
        assert list(files.names) == ["00.png", "02.png", "03.png", "04.png"]
        assert files.test_names == {"00.png"}

    def test_filenames_that_match_no_frame_are_refused(self, tmp_path):
        write_nerfstudio(tmp_path, WORLD, train_filenames=["elsewhere/1.png"])
        with pytest.raises(UserError, match="name no file_path"):
            read(tmp_path)

    @pytest.mark.parametrize("wrong", [5, [["images/00.png"]], "images/00.png"])
    def test_filenames_that_are_no_list_are_refused(self, tmp_path, wrong):
        write_nerfstudio(tmp_path, WORLD, train_filenames=wrong)
        with pytest.raises(UserError, match=r"train_filenames is .*expected a list"):
            read(tmp_path)

    @pytest.mark.parametrize("write", [write_blender, write_nerfstudio])
    def test_stated_bounds(self, tmp_path, write):
        write(tmp_path, WORLD)
        for path in tmp_path.glob("*.json"):
            edit_json(path, lambda c: c.update(near=1, far=5.5))
        assert (read(tmp_path).bounds == [1.0, 5.5]).all()

    def test_depths_of_frames_are_all_kept(self, tmp_path):
        write_nerfstudio(tmp_path, WORLD)

        def deepen(content):
            for number, frame in enumerate(content["frames"]):
                frame |= {"near": 1.0 + number, "far": 9.0 + number}

        edit_json(tmp_path / "transforms.json", deepen)
        bounds = read(tmp_path).bounds
        assert (bounds[:, 0].min(), bounds[:, 1].max()) == (1.0, 8.0 + len(bounds))

    @pytest.mark.parametrize(
        "change",
        [
            lambda path: path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes()),
            lambda path: path.write_text(path.read_text(), encoding="utf-16"),
            lambda path: path.write_text(
                path.read_text().replace("images/", "C:\\\\photos\\\\images\\\\")
            ),
            lambda path: path.write_text(
                path.read_text().replace("images/", "/home/somebody/scene/images/")
            ),
        ],
        ids=["mark", "utf-16", "windows", "elsewhere"],
    )
    def test_encodings_and_paths_of_other_machines(self, tmp_path, change):
        write_nerfstudio(tmp_path, WORLD)
        expected = read(tmp_path)
        change(tmp_path / "transforms.json")
        again = read(tmp_path)
        assert again.image_paths == expected.image_paths
        assert again.names == expected.names

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            ({"k4": 0.01}, "k4 of .* no such term"),
            ({"camera_angle_x": 60.0, "fl_x": None}, "radians"),
            ({"test_filenames": ["images/none.png"]}, "test_filenames"),
        ],
    )
    def test_what_would_be_misread_is_refused(self, tmp_path, change, message):
        write_nerfstudio(tmp_path, WORLD)

        def edit(content):
            content |= change
            for frame in (content, *content["frames"]):
                for key in [k for k, value in change.items() if value is None]:
                    frame.pop(key, None)

        edit_json(tmp_path / "transforms.json", edit)
        with pytest.raises(UserError, match=message):
            read(tmp_path)

    def test_a_test_view_without_its_photo_is_left_out_and_said(self, tmp_path, capsys):
        write_blender(tmp_path, WORLD)
        test = tmp_path / "transforms_test.json"
        edit_json(test, lambda c: c["frames"][0].update(file_path="./high/secret.jpg"))
        files = read(tmp_path)
        assert "secret.jpg" in capsys.readouterr().out
        assert all("secret" not in name for name in files.names)

    @pytest.mark.parametrize("extension", [".JPG", ""])
    def test_extension_and_case_are_found(self, tmp_path, extension):
        write_nerfstudio(tmp_path, WORLD)
        frames = frame_entries(WORLD, "images")
        for frame in frames:
            frame["file_path"] = frame["file_path"].removesuffix(".png") + extension
        path = tmp_path / "transforms.json"
        edit_json(path, lambda c: c.update(frames=frames))
        assert list(read(tmp_path).names) == WORLD.names

    def test_points_come_from_the_model_beside_through_the_similarity(self, tmp_path):
        write_nerfstudio(tmp_path, WORLD)
        other = WORLD.moved(3.7, random_rotation(), np.array([1.0, -2.0, 5.0]))
        write_model(tmp_path / "colmap_sparse/0", other)
        points = read(tmp_path).points
        order = [np.lexsort(p.round(6).T) for p in (points, WORLD.points)]
        np.testing.assert_allclose(points[order[0]], WORLD.points[order[1]], atol=1e-9)

    @pytest.mark.parametrize(
        "spoil",
        [
            lambda w: w.camtoworlds[::-1],  # other cameras under these names
            lambda w: np.tile(w.camtoworlds[:1], (6, 1, 1)),  # all at one place
            lambda w: w.camtoworlds @ np.diag([-1.0, -1.0, 1.0, 1.0]),  # turned
            lambda w: w.camtoworlds + 0.05 * np.eye(6)[:, :1, None] * np.eye(4)[3],
        ],
        ids=["shuffled", "one place", "upside down", "one centre moved"],
    )
    def test_points_of_other_cameras_are_not_used(self, tmp_path, capsys, spoil):
        write_nerfstudio(tmp_path, WORLD)
        other = dataclasses.replace(WORLD, camtoworlds=spoil(WORLD))
        write_model(tmp_path / "sparse", other)
        assert len(read(tmp_path).points) == 0
        assert "warning" in capsys.readouterr().out

    def test_points_need_three_common_images(self, tmp_path, capsys):
        write_nerfstudio(tmp_path, WORLD)
        two = World(WORLD.camtoworlds[:2], WORLD.points)
        write_model(tmp_path / "sparse/0", two)
        assert len(read(tmp_path).points) == 0
        assert "fewer than 3" in capsys.readouterr().out

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            (lambda c: c.pop("frames"), 'no "frames"'),
            (
                lambda c: c["frames"][2].pop("file_path"),
                "frame 2 has no",
            ),
            (lambda c: c["frames"][2].pop("transform_matrix"), "03.png is not a 4x4"),
            (
                lambda c: c["frames"][2].update(transform_matrix=[[1.0, 2.0], [3.0]]),
                "03.png is not a 4x4",
            ),
            (
                lambda c: c["frames"][2].update(file_path="images/gone.png"),
                "gone.png: image not found, but .*transforms.json lists it",
            ),
            (lambda c: c.pop("fl_x") and c.pop("fl_y"), "no focal length"),
            (lambda c: c.update(fl_x=-20.0), "fl_x of .* is -20"),
            (lambda c: c.update(fl_x="20"), "fl_x of .* is '20'; expected a finite"),
            (lambda c: c.update(k1=math.nan), "k1 of .* is nan"),
            (lambda c: c.update(w=0), "picture size 0x18 is empty"),
            (lambda c: c.update(near="1", far=2), "near of .* is '1'"),
            (lambda c: c.update(camera_model="LEICA"), "unknown camera_model 'LEICA'"),
        ],
    )
    def test_broken_json_is_refused(self, tmp_path, change, message):
        write_nerfstudio(tmp_path, WORLD)
        edit_json(tmp_path / "transforms.json", change)
        with pytest.raises(UserError, match=message):
            read(tmp_path)

    def test_truncated_json_is_refused(self, tmp_path):
        write_nerfstudio(tmp_path, WORLD)
        path = tmp_path / "transforms.json"
        path.write_text(path.read_text()[:100])
        with pytest.raises(UserError, match=r"transforms\.json: not a JSON file"):
            read(tmp_path)


def spoiled(rows: np.ndarray, place: tuple[int, int], value: float) -> np.ndarray:
    changed = rows.copy()
    changed[place] = value
    return changed


class TestLlff:
    def test_lens_is_at_the_stated_size_and_bounds_are_per_view(self, tmp_path):
        rows = llff_rows(WORLD, (2.0, 7.0))
        rows[:, 15] += np.arange(6)
        write_pictures(tmp_path / "images_4", WORLD.names)
        write_pictures(tmp_path / "images_8", WORLD.names)
        np.save(tmp_path / "poses_bounds.npy", rows)
        files = read(tmp_path)
        assert files.image_paths[0].parent.name == "images_4"
        np.testing.assert_array_equal(files.bounds[:, 0], 2.0 + np.arange(6))

    def test_counts_must_agree(self, tmp_path):
        write_llff(tmp_path, WORLD)
        (tmp_path / "images" / WORLD.names[0]).unlink()
        with pytest.raises(UserError, match="6 poses but 5 pictures"):
            read(tmp_path)

    @pytest.mark.parametrize(
        ("spoil", "message"),
        [
            (lambda rows: rows[:, :15], r"shape \(6, 15\); expected \(views, 17\)"),
            (lambda rows: spoiled(rows, (3, 4), -1.0), "row 3"),
            (lambda rows: spoiled(rows, (5, 16), np.nan), "row 5"),
        ],
    )
    def test_broken_rows_are_refused(self, tmp_path, spoil, message):
        write_llff(tmp_path, WORLD)
        path = tmp_path / "poses_bounds.npy"
        np.save(path, spoil(np.load(path)))
        with pytest.raises(UserError, match=message):
            read(tmp_path)

    @pytest.mark.parametrize("content", [b"", b"not numpy", b"\x93NUMPY\x01"])
    def test_broken_file_is_refused(self, tmp_path, content):
        write_llff(tmp_path, WORLD)
        (tmp_path / "poses_bounds.npy").write_bytes(content)
        with pytest.raises(UserError, match="not a NumPy file"):
            read(tmp_path)


class TestColmap:
    @pytest.mark.parametrize("binary", [True, False], ids=["bin", "txt"])
    @pytest.mark.parametrize("model", ["sparse/0", "sparse", "colmap_sparse/0"])
    def test_places_and_encodings(self, tmp_path, model, binary):
        write_colmap(tmp_path, WORLD, model, binary)
        assert list(read(tmp_path).names) == WORLD.names

    def test_pictures_in_low(self, tmp_path):
        write_colmap(tmp_path, WORLD)
        (tmp_path / "images").rename(tmp_path / "low")
        assert read(tmp_path).image_paths[0] == tmp_path / "low" / "00.png"

    def test_a_pose_whose_photo_is_gone_is_left_out_and_said(self, tmp_path, capsys):
        write_colmap(tmp_path, WORLD)
        whole = read(tmp_path)
        (tmp_path / "images" / "03.png").unlink()
        rest = read(tmp_path)
        assert "03.png left out" in capsys.readouterr().out
        kept = [view for view, name in enumerate(whole.names) if name != "03.png"]
        assert rest.names == tuple(whole.names[view] for view in kept)
        np.testing.assert_array_equal(rest.camtoworlds, whole.camtoworlds[kept])
        assert [path.name for path in rest.image_paths] == list(rest.names)

    def test_photos_of_other_names_are_no_partners(self, tmp_path):
        write_colmap(tmp_path, WORLD)
        for path in list((tmp_path / "images").iterdir()):
            path.rename(path.with_name(f"renamed_{path.name}"))
        with pytest.raises(UserError, match="none of its"):
            read(tmp_path)

    def test_of_several_models_the_largest_is_taken(self, tmp_path):
        write_colmap(tmp_path, WORLD)
        whole = read(tmp_path)
        (tmp_path / "sparse" / "0").rename(tmp_path / "sparse" / "1")
        few = dataclasses.replace(WORLD, camtoworlds=WORLD.camtoworlds[:3])
        write_model(tmp_path / "sparse" / "0", few)
        assert read(tmp_path).names == whole.names

    def test_photos_without_a_pose_are_left_out(self, tmp_path):
        write_colmap(tmp_path, WORLD)
        write_pictures(tmp_path / "images", ["99.png"])
        assert list(read(tmp_path).names) == WORLD.names

    def test_model_without_images_is_refused(self, tmp_path):
        write_colmap(tmp_path, dataclasses.replace(WORLD, points=np.empty((0, 3))))
        empty = World(np.empty((0, 3, 4)), np.empty((0, 3)))
        write_model(tmp_path / "sparse/0", empty)
        with pytest.raises(UserError, match="no registered image"):
            read(tmp_path)


def change_first(key, value):
    return lambda content: content["frames"][0].update({key: value})


@pytest.mark.parametrize(
    "key, value, words",
    [
        (
            "transform_matrix",
            np.vstack([WORLD.camtoworlds[0], [0, 0, 0, 1]]).T.tolist(),
            r"last row .* transpose it",
        ),
        ("transform_matrix", [[10**400] * 4] * 4, "not a 4x4"),
        ("fl_x", 0.0, r"fl_x of .* is 0; expected pixels, above 0"),
        ("fl_y", -20.0, r"fl_y of .* is -20; expected pixels, above 0"),
    ],
)
def test_a_frame_that_cannot_be_meant_is_refused(key, value, words, tmp_path):
    folder = write_nerfstudio(tmp_path, WORLD)
    edit_json(folder / "transforms.json", change_first(key, value))
    with pytest.raises(UserError, match=words):
        readers.read_files(folder, "auto", "")


def test_a_view_of_both_splits_is_held_out_and_named(tmp_path, capsys):
    folder = write_blender(tmp_path, WORLD)

    def also_train(content):
        content["frames"] += frame_entries(WORLD, "low")[1:2]

    edit_json(folder / "transforms_test.json", also_train)
    files = readers.read_files(folder, "auto", "")
    assert files.test_names == frozenset(WORLD.names[:2])
    assert "1 of its views are in transforms_train.json too" in capsys.readouterr().out


def test_a_folder_of_two_formats_says_which_is_read(tmp_path, capsys):
    write_nerfstudio(tmp_path, WORLD)
    write_colmap(tmp_path, WORLD)
    assert readers.read_files(tmp_path, "auto", "").format == "nerfstudio"
    assert "read as nerfstudio; it has the files of colmap" in capsys.readouterr().out


def test_a_picture_that_no_frame_lists_is_named(tmp_path, capsys):
    folder = write_nerfstudio(tmp_path, WORLD)
    edit_json(folder / "transforms.json", lambda content: content["frames"].pop())
    assert len(readers.read_files(folder, "auto", "").names) == len(WORLD.names) - 1
    said = capsys.readouterr().out
    assert "1 of 6 pictures are in no frame of transforms.json: 00.png left out" in said
