# SPDX-License-Identifier: Apache-2.0
"""HTML from Jinja2 templates, which lie beside the modules that fill them.

Texts are escaped, and a name that the template asks for and nobody gave is an error.
The only module that imports Jinja2.
"""

import functools
from pathlib import Path

import jinja2


def fill(template: Path, **values: object) -> str:
    """The text of a template file; it may include its neighbours by name."""
    return _environment(template.parent).get_template(template.name).render(values)


@functools.cache
def _environment(folder: Path) -> jinja2.Environment:
    return jinja2.Environment(
        loader=jinja2.FileSystemLoader(folder),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
