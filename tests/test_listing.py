# SPDX-License-Identifier: Apache-2.0
"""What lies in folders of photos: pictures are found, the rest is left out."""

import os
import unicodedata

import pytest
from hypothesis import given
from hypothesis import strategies as st

from internal import extras
from internal.errors import UserError
from internal.files import atomic, listing, made_folder

WASTE = (
    "@eaDir/1.jpg/SYNOPHOTO_THUMB_M.jpg",
    "sub/@eaDir/2.jpg",
    "__MACOSX/._1.jpg",
    "._1.jpg",
    ".DS_Store",
    ".Trash-1000/files/old.jpg",
    ".thumbnails/1.jpg",
    "#recycle/old.png",
    "$RECYCLE.BIN/old.png",
    "Thumbs.db",
    "desktop.ini",
    "1.jpg.xmp",
    "IMG_1.MOV",
    "notes.txt",
)


def fill(folder, *names):
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(b"content")
    return folder


def test_what_systems_and_servers_leave_is_no_photo(tmp_path, capsys):
    fill(tmp_path, "1.jpg", "sub/2.PNG", *WASTE)
    found = listing.find_pictures(tmp_path)
    assert found == listing.Listing(("1.jpg", "sub/2.PNG"), (), ())
    assert listing.list_pictures(tmp_path) == found.pictures
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("ending", "jpe jfif heic HEIF avif tiff webp jxl exr".split())
def test_every_ending_that_is_read_is_listed(tmp_path, ending):
    fill(tmp_path, f"1.{ending}")
    assert listing.list_pictures(tmp_path) == (f"1.{ending}",)


def test_a_name_that_is_no_text_is_left_out_in_letters_that_are(tmp_path, capsys):
    fill(
        tmp_path,
        "1.jpg",
        "a\nb.jpg",
        os.fsdecode(b"caf\xe9.jpg"),
        os.fsdecode(b"\xfc/2.jpg"),
    )
    assert listing.list_pictures(tmp_path) == ("1.jpg",)
    said = capsys.readouterr().out
    assert "a\\nb.jpg (a line break in its name" in said
    assert "\\udcfc/2.jpg, caf\\udce9.jpg (its name or a folder's is not UTF-8" in said


def test_pictures_left_out_are_named_with_the_reason_once(
    tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr(extras, "has", lambda *_: False)
    fill(tmp_path, "1.jpg", "2.gif", "3.heic", "4.DNG", "5.nrw", "thumbs/1.jpg")
    (tmp_path / "6.jpg").symlink_to("nowhere.jpg")
    os.mkfifo(tmp_path / "7.jpg")  # reading it would never end
    for _ in range(2):
        assert listing.list_pictures(tmp_path) == ("1.jpg",)
    (printed,) = capsys.readouterr().out.splitlines()
    for part in (
        "2.gif (a kind of picture that is not read; export",
        "3.heic (needs the extra: pip install -e '.[heif]')",
        "4.DNG (RAW, to be developed",
        "5.nrw (RAW of a kind that is not read",
        "6.jpg (a link to nothing)",
        "7.jpg (not a file)",
        "thumbs/1.jpg (in a folder of thumbnails",
    ):
        assert part in printed


def test_a_folder_without_pictures_says_what_was_left_out(tmp_path):
    fill(tmp_path, "2.gif", *WASTE)
    with pytest.raises(UserError, match=r"no picture .* left out: 2\.gif"):
        listing.list_pictures(tmp_path)


def test_links_are_followed_and_no_folder_is_entered_twice(tmp_path):
    real = fill(tmp_path / "elsewhere", "3.jpg", "4.jpg")
    photos = fill(tmp_path / "photos", "b/1.jpg")
    (photos / "2.jpg").symlink_to(real / "4.jpg")
    (photos / "more").symlink_to(real)
    (photos / "a").symlink_to(photos / "b")  # sorted before the real one
    (photos / "b" / "loop").symlink_to(photos)
    (real / "back").symlink_to(photos)
    (tmp_path / "linked").symlink_to(photos)
    expected = ("2.jpg", "b/1.jpg", "more/3.jpg", "more/4.jpg")
    assert listing.list_pictures(photos) == expected
    assert listing.list_pictures(tmp_path / "linked") == expected


def test_a_folder_named_like_a_photo_is_a_folder(tmp_path):
    fill(tmp_path, "1.jpg/2.jpg")
    assert listing.list_pictures(tmp_path) == ("1.jpg/2.jpg",)


def test_files_are_found_under_the_other_form_of_their_name(tmp_path):
    disk, asked = (unicodedata.normalize(form, "é/ü.png") for form in ("NFD", "NFC"))
    fill(tmp_path, disk)
    assert disk != asked
    assert listing.find_file(tmp_path / asked) == tmp_path / disk
    assert listing.find_file(tmp_path / "x" / "y") == tmp_path / "x" / "y"


def test_metadata_does_not_occupy_a_folder_and_a_file_does(tmp_path):
    fill(tmp_path / "out", ".DS_Store", "desktop.ini", "@eaDir/x")
    made_folder.begin_folder(tmp_path / "out", {}, overwrite=False)
    fill(tmp_path / "mine", "notes.txt")
    with pytest.raises(UserError, match="not made by this program"):
        made_folder.begin_folder(tmp_path / "mine", {}, overwrite=False)


def test_an_error_names_the_file_it_is_about(tmp_path):
    out, source = tmp_path / "out", tmp_path / "photos" / "gone.jpg"
    for path, named in ((source, source), (out / "x" / "y", out)):
        with pytest.raises(UserError, match=f"^{named}: cannot"), atomic.naming(out):
            path.read_bytes()


def test_flat_names_meet_on_no_disk():
    names = ("1.jpg", "a/1.jpg", "/b/1.jpg", "1.png", "A_1.JPG", "1.PNG", "1_png.jpg")
    assert listing.flat_pngs(names) == (
        *("1.png", "a_1.png", "b_1.png", "1_png.png", "A_1_JPG.png"),
        *("1_PNG_2.png", "1_png_jpg.png"),
    )


@given(st.lists(st.text("aA1_/.éé", min_size=1), unique=True))
def test_flat_names_are_as_many_as_names(names):
    flat = listing.flat_pngs(names)
    assert len({listing.composed(name).casefold() for name in flat}) == len(names)
    assert not any("/" in name for name in flat)
