# SPDX-License-Identifier: Apache-2.0
"""The lists of methods: what they may hold, and what they become for a scene."""

from pathlib import Path

import pytest

from internal import extras
from internal.comparison.methods import Method, methods_for, read_methods
from internal.errors import UserError

LISTS = Path(__file__).parents[1] / "configs" / "methods"


@pytest.fixture
def write(tmp_path):
    def write(text):
        path = tmp_path / "list.toml"
        path.write_text(text)
        return [path]

    return write


@pytest.mark.parametrize("models", ["models.toml", "short.toml"])
def test_the_lists_of_the_project_are_read_together(models):
    files = [LISTS / "photos.toml", LISTS / models]
    names = [method.name for method in read_methods(files)]
    assert {"dark photo", "LIME, denoised", "{folder} + NeRF", "LLNeRF"} <= set(names)


def test_an_entry_without_keys_is_the_dark_photo(write):
    assert read_methods(write('["dark"]')) == (Method("dark", "", (), "unchanged"),)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("[a", "not a list of methods"),
        ("a = 1", "expected a table"),
        ("[a]\nphoto = 'x'", "no photo there"),
        ("[a]\nphotos = 1", "photos is a text"),
        ("[a]\noutput = 'v'", "output one of unchanged"),
        ("[a]\ntrain = 'x.gin'", "list of gin files"),
        ("[a]\ntrain = ['none.gin']", "none.gin: no such gin file"),
        ("[a]\noutput = 'enhanced'", "needs a model"),
        ("[a]\nphotos = 'enhanced/*'", "go together"),
        ("['{folder}']\nphotos = 'enhanced'", "go together"),
    ],
)
def test_a_broken_list_is_one_line_with_its_name(write, text, complaint):
    with pytest.raises(UserError, match=rf"list\.toml.*{complaint}"):
        read_methods(write(text))


def test_a_missing_list_and_a_name_twice_are_refused(write, tmp_path):
    with pytest.raises(UserError, match=r"none\.toml: not a list"):
        read_methods([tmp_path / "none.toml"])
    with pytest.raises(UserError, match=r'\["a"\] comes twice'):
        read_methods(write("[a]") * 2)


def test_a_star_is_a_method_per_folder(tmp_path):
    for name in ("B", "A"):
        (tmp_path / "enhanced" / name).mkdir(parents=True)
    (tmp_path / "enhanced" / "notes.txt").touch()
    (tmp_path / "enhanced" / "@eaDir").mkdir()
    star = Method("{folder} + NeRF", "enhanced/*", ("x.gin",))
    assert methods_for([star, Method("dark")], tmp_path) == (
        Method("A + NeRF", "enhanced/A", ("x.gin",)),
        Method("B + NeRF", "enhanced/B", ("x.gin",)),
        Method("dark"),
    )
    assert methods_for([star], tmp_path / "enhanced") == ()


def test_a_folder_that_is_not_there_is_named(tmp_path):
    with pytest.raises(UserError, match=r"mine: no such folder.*\[\"my method\"\]"):
        methods_for([Method("my method", "mine")], tmp_path)


def test_without_opencv_the_method_is_named_before_any_work(tmp_path, monkeypatch):
    monkeypatch.setattr(extras, "has", lambda *_: False)
    with pytest.raises(UserError, match=r"clahe needs cv2.*enhance2d"):
        methods_for([Method("CLAHE", "clahe")], tmp_path)
