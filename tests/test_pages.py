# SPDX-License-Identifier: Apache-2.0
"""The page of an output folder, contact sheets, and files written whole."""

import html.parser

import jinja2
import numpy as np
import pytest

from internal.errors import UserError
from internal.files import atomic, image_io, templates
from internal.pages import contact_sheet, pages

SECTIONS = [
    pages.Section(
        "Enhanced",
        "What the method sees <in> the light & shade.",
        (
            ("enhanced/view 1.png", 'a "quoted" <caption>'),
            ("enhanced/path.mp4", "spiral"),
            ("depth/view 1.exr", "depth"),
        ),
    ),
    pages.Table("Scores", "Against truth.", ("view", "PSNR"), (("1", "21.30"),)),
]


class _Page(html.parser.HTMLParser):
    """Collects what a browser would see, and checks that tags are balanced."""

    VOID = frozenset(["img", "meta"])

    def __init__(self, text: str):
        super().__init__()
        self.tags, self.links, self.words, self.open = [], [], [], []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.links += [value for name, value in attrs if name in ("href", "src")]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)


@pytest.fixture
def page(tmp_path):
    path = pages.write_index(tmp_path, "Scene <b>", "An intro.", SECTIONS)
    assert path == tmp_path / "index.html"
    return _Page(path.read_text(encoding="utf-8"))


def test_page_is_self_contained(page):
    assert page.tags.count("style") == 1
    assert not {"script", "link", "iframe"} & set(page.tags)
    assert all("://" not in link and link[0] != "/" for link in page.links)


def test_page_shows_each_kind_of_file_in_its_way(page):
    assert page.tags.count("img") == 1
    assert page.tags.count("video") == 1
    assert "depth/view%201.exr" in page.links
    assert page.links.count("enhanced/view%201.png") == 2  # shown, and in full


def test_page_escapes_texts(page):
    words = "".join(page.words)
    assert "What the method sees <in> the light & shade." in words
    assert 'a "quoted" <caption>' in words
    assert not {"b", "in", "caption"} & set(page.tags)


def test_page_has_the_table(page):
    assert page.tags.count("tr") == 2
    assert "21.30" in page.words


def test_what_a_page_lacks_is_an_error_not_a_gap():
    with pytest.raises(jinja2.UndefinedError, match="intro"):
        templates.fill(pages.ASSETS / "page.html", title="Scene", parts=SECTIONS)


def test_page_in_a_missing_folder_is_the_users_error(tmp_path):
    with pytest.raises(UserError, match=r"index\.html: cannot write"):
        pages.write_index(tmp_path / "missing", "", "", [])


def test_a_file_that_failed_leaves_the_old_one_and_nothing_else(tmp_path):
    path = tmp_path / "file.txt"
    path.write_text("old")
    with pytest.raises(ZeroDivisionError), atomic.writing(path) as partial:
        partial.write_text("half of the n")
        raise ZeroDivisionError
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def _flat(value: float, height: int, width: int) -> np.ndarray:
    return np.full((height, width, 3), value, np.float32)


def _box(sheet: np.ndarray, value: float) -> tuple[int, int]:
    """Height and width of the area that has exactly this value."""
    rows, columns = np.nonzero((sheet == np.float32(value)).all(axis=-1))
    return int(np.ptp(rows)) + 1, int(np.ptp(columns)) + 1


def test_sheet_enlarges_all_pictures_by_one_whole_factor():
    # 320 / 100 rounds up to 4.
    rows = [[_flat(0.25, 50, 100), _flat(0.5, 20, 40)]]
    sheet = contact_sheet.contact_sheet(rows, [""], ["dark", "bright"])
    assert _box(sheet, 0.25) == (200, 400)
    assert _box(sheet, 0.5) == (80, 160)


def test_sheet_shows_large_pictures_as_they_are():
    sheet = contact_sheet.contact_sheet([[_flat(0.25, 300, 400)]], [""], [""])
    assert _box(sheet, 0.25) == (300, 400)


def test_sheet_has_ink_only_where_labels_are():
    rows = [[_flat(0.25, 40, 60)], [_flat(0.5, 40, 60)]]

    def is_inked(row_labels, column_label):
        sheet = contact_sheet.contact_sheet(rows, row_labels, [column_label])
        return bool((sheet > 0.6).any())

    assert not is_inked(["", ""], "")
    assert is_inked(["", ""], "dark")
    assert is_inked(["", "view 2"], "")


def test_sheet_keeps_a_long_label_off_its_neighbours():
    rows = [[_flat(0.25, 40, 60), _flat(0.25, 40, 60)]]
    sheet = contact_sheet.contact_sheet(rows, [""], ["a long label " * 9, ""])
    right = sheet[: contact_sheet.LABEL_HEIGHT, sheet.shape[1] // 2 + 8 :]
    assert right.max() < 0.1


def test_sheet_shrinks_a_label_that_is_a_little_too_long():
    label = "a label that needs a much smaller font to fit in here"
    sheet = contact_sheet.contact_sheet([[_flat(0.25, 40, 320)]], [""], [label])
    inked = np.nonzero((sheet > 0.6).any(axis=(0, 2)))[0]
    assert inked.min() > contact_sheet.GAP
    assert inked.max() < contact_sheet.GAP + 320 - 1


def test_side_by_side_is_read_back(tmp_path):
    path = tmp_path / "pair.png"
    contact_sheet.side_by_side(
        [("dark", _flat(0.2, 40, 60)), ("enhanced", _flat(0.6, 40, 60))], path
    )
    sheet = image_io.read_srgb(path)
    middle = sheet[sheet.shape[0] // 2]
    np.testing.assert_allclose(middle[sheet.shape[1] // 4], 0.2, atol=2e-3)
    np.testing.assert_allclose(middle[sheet.shape[1] * 3 // 4], 0.6, atol=2e-3)
