# SPDX-License-Identifier: Apache-2.0
"""Pictures find their partners by name, or say plainly that they cannot."""

import random
import shutil
import unicodedata
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from internal.errors import UserError
from internal.files import image_io
from internal.scene import pairing


def folder_of(tmp_path: Path, *names: str) -> Path:
    for name in names:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    return tmp_path


@pytest.mark.parametrize(
    ("names", "files", "rule"),
    [
        (["1.JPG", "2.JPG"], ["1.JPG", "2.JPG"], "equal names"),
        (["1.JPG", "2.JPG"], ["1.png", "2.png"], "equal names up to the extension"),
        (["A.JPG", "b.JPG"], ["a.jpg", "B.png"], "equal names up to case"),
        (["1.JPG", "10.JPG"], ["enh_1.png", "enh_10.png"], "equal numbers"),
        (["1.JPG", "10.JPG"], ["1_enh.png", "10_enh.png"], "equal numbers"),
        (["IMG_007.JPG", "IMG_012.JPG"], ["7.png", "12.png"], "equal numbers"),
        (["2.JPG", "10.JPG"], ["dawn.png", "dusk.png"], "sorted order"),
        (["IMG_7.JPG", "IMG_10.JPG"], ["image000.png", "image001.png"], "sorted order"),
        (["left/1.png", "right/1.png"], ["left/1.jpg", "right/1.jpg"], "equal names"),
    ],
)
def test_each_rule_pairs(tmp_path, names, files, rule):
    paths, how = pairing.pair_by_name(names, folder_of(tmp_path, *files))
    assert [path.relative_to(tmp_path).as_posix() for path in paths] == files
    assert how.startswith(rule)


def test_stricter_rule_wins(tmp_path):
    """Both files have the stem of 1.JPG; the equal name is the partner."""
    folder = folder_of(tmp_path, "1.JPG", "1.png")
    assert pairing.pair_by_name(["1.JPG"], folder) == (
        (folder / "1.JPG",),
        "equal names",
    )


def test_extra_files_and_non_pictures_do_no_harm(tmp_path):
    folder = folder_of(tmp_path, "1.JPG", "2.JPG", "3.JPG", "notes.txt", ".hidden.png")
    paths, _ = pairing.pair_by_name(["3.JPG", "1.JPG"], folder)
    assert paths == (folder / "3.JPG", folder / "1.JPG")


def test_order_counts_pictures_without_a_pose(tmp_path):
    """COLMAP placed a and c of a, b, c: c's partner is the third, not the second."""
    folder = folder_of(tmp_path, "x.png", "y.png", "z.png")
    paths, how = pairing.pair_by_name(
        ["a.png", "c.png"], folder, population=["a.png", "b.png", "c.png"]
    )
    assert [path.name for path in paths] == ["x.png", "z.png"]
    assert how == "sorted order"


@pytest.mark.parametrize(
    ("names", "files"),
    [
        (["a.png", "b.png"], ["x.png", "y.png", "z.png"]),  # counts differ
        (["a.png", "b.png", "c.png"], ["x.png", "y.png"]),
        (["1.png", "4.png"], ["1.png", "2.png", "3.png"]),  # one has no partner
        (["a1.png", "b1.png"], ["1.png", "2.png", "3.png"]),  # both claim number 1
        (["a.png"], ["a.jpg", "a.tif"]),  # two partners
    ],
)
def test_ambiguity_is_refused_with_counts_and_an_example(tmp_path, names, files):
    folder = folder_of(tmp_path, *files)
    with pytest.raises(UserError) as error:
        pairing.pair_by_name(names, folder)
    message = str(error.value)
    assert str(folder) in message
    assert f"{len(files)} pictures with {len(names)} views" in message
    assert any(repr(name) in message for name in names)


def test_message_names_the_lonely_one(tmp_path):
    folder = folder_of(tmp_path, "1.png", "2.png", "3.png")
    with pytest.raises(UserError, match=r"'4\.png' has no partner"):
        pairing.pair_by_name(["1.png", "4.png"], folder)


@given(st.sets(st.integers(0, 999), min_size=2, max_size=12), st.randoms())
def test_pairing_follows_the_views_in_any_order(tmp_path_factory, numbers, rng):
    folder = folder_of(
        tmp_path_factory.mktemp("enhanced"), *(f"e_{n:04}.png" for n in numbers)
    )
    shuffled = sorted(numbers)
    random.Random(rng.random()).shuffle(shuffled)
    paths, _ = pairing.pair_by_name([f"{n}.JPG" for n in shuffled], folder)
    assert [int(path.stem[2:]) for path in paths] == shuffled


def test_missing_empty_and_raw_folders_say_so(tmp_path):
    with pytest.raises(UserError, match="folder of pictures not found"):
        pairing.list_pictures(tmp_path / "none")
    with pytest.raises(UserError, match="no picture"):
        pairing.list_pictures(tmp_path)
    with pytest.raises(UserError, match="RAW photos must be developed"):
        pairing.list_pictures(folder_of(tmp_path, "1.DNG", "2.DNG"))


@pytest.mark.parametrize(
    ("present", "images_dir", "expected"),
    [
        (["images", "low", "images_4"], "", "images"),
        (["low", "high", "images_4"], "", "low"),
        (["images_16", "images_4", "images_8"], "", "images_4"),
        (["images", "images_8"], "images_8", "images_8"),
        (["images", "enhanced/sci"], "enhanced/sci", "enhanced/sci"),
    ],
)
def test_input_folder(tmp_path, present, images_dir, expected):
    for name in present:
        (tmp_path / name).mkdir(parents=True)
    found = pairing.find_input_folder(tmp_path, images_dir)
    assert found == tmp_path / expected


@pytest.mark.parametrize("images_dir", ["", "images_3"])
def test_missing_input_folder_names_what_was_looked_for(tmp_path, images_dir):
    with pytest.raises(UserError, match=r"looked for images(_3|, low or images_N)"):
        pairing.find_input_folder(tmp_path, images_dir)


def test_truth_lies_beside_the_dark_folder_or_in_the_scene(tmp_path, capsys):
    dark = tmp_path / "enhanced" / "sci"
    assert pairing.find_truth_folder(tmp_path, dark) is None
    folder_of(tmp_path, "high/1.png", "gt/._1.png", "images_normal/1.npy")
    assert pairing.find_truth_folder(tmp_path, dark) == tmp_path / "high"
    folder_of(tmp_path, "enhanced/gt/1.png")
    assert pairing.find_truth_folder(tmp_path, dark) == tmp_path / "enhanced" / "gt"
    shutil.rmtree(tmp_path / "high")
    assert pairing.find_truth_folder(tmp_path, tmp_path / "low") is None
    printed = capsys.readouterr().out
    for name in ("gt", "images_normal"):
        assert f"{tmp_path / name}: not taken as truth: no picture" in printed


def a_sphere() -> np.ndarray:
    """Surface normals of a sphere before nothing."""
    y, x = np.mgrid[1:-1:64j, -1:1:64j]
    z = np.sqrt(np.maximum(1.0 - x**2 - y**2, 0.0))
    return np.where(z[..., None] > 0.0, np.stack([x, y, z], -1), 0.0).astype(np.float32)


@pytest.mark.parametrize("ending", ["png", "jpg", "exr"])
def test_surface_normals_are_no_truth(tmp_path, capsys, ending):
    normals = a_sphere() if ending == "exr" else (a_sphere() + 1.0) / 2.0
    (tmp_path / "normal").mkdir()
    for i in range(3):
        image_io.write(tmp_path / "normal" / f"{i}.{ending}", normals)
    assert pairing.find_truth_folder(tmp_path, tmp_path / "low") is None
    printed = capsys.readouterr().out
    assert printed == (
        f"{tmp_path / 'normal'}: not taken as truth: it holds surface normals\n"
    )


@pytest.mark.parametrize("level", [0.1, 0.21, 0.5, 0.79, 1.0])
def test_photos_in_a_folder_called_normal_are_truth(tmp_path, level):
    """Greys of 0.21 and 0.79 are as far from 0.5 as unit vectors are."""
    (tmp_path / "normal").mkdir()
    photo = level * np.random.default_rng(0).uniform(0.9, 1.0, (64, 64, 3))
    photo[:32] *= (0.3, 0.6, 0.9)
    image_io.write(tmp_path / "normal" / "1.png", photo)
    found = pairing.find_truth_folder(tmp_path, tmp_path / "low")
    assert found == tmp_path / "normal"


@pytest.mark.parametrize("forms", [("NFD", "NFC"), ("NFC", "NFD")])
def test_names_pair_in_either_form_of_unicode(tmp_path, forms):
    disk, stated = (unicodedata.normalize(form, "é.png") for form in forms)
    folder_of(tmp_path, disk, "2.png")
    paths, rule = pairing.pair_by_name([stated, "2.png"], tmp_path)
    assert paths == (tmp_path / disk, tmp_path / "2.png")
    assert rule == "equal names"


def test_dark_twin_of_a_bright_listing(tmp_path):
    bright = tmp_path / "high" / "1.JPG"
    assert pairing.dark_twin(bright) == bright
    (tmp_path / "low").mkdir()
    assert pairing.dark_twin(bright) == tmp_path / "low" / "1.JPG"
    other = tmp_path / "train" / "1.JPG"
    assert pairing.dark_twin(other) == other
    assert pairing.dark_twin(Path("1.JPG")) == Path("1.JPG")  # a scene in "."


@pytest.mark.parametrize(
    ("names", "candidates"),
    [
        (["a/1.png", "b/1.png"], ["1.png"]),
        (["1"], ["1.png", "1.jpg"]),
        (["1.JPG", "1.jpg"], ["1.png"]),
    ],
)
def test_a_name_of_two_meanings_means_none(names, candidates):
    assert pairing.match_by_name(names, candidates) == {}
