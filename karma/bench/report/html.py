"""Render pages from templates: all text escaped, pictures inline, no script, nothing fetched."""

import base64
import hashlib
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from karma import __version__
from karma.bench.figures.drawing import Plot, svg_of

if TYPE_CHECKING:
    import jinja2

TEMPLATES = Path(__file__).parent


def fill(template: str, **words: Any) -> str:
    """Return a page; `words` are the variables of its template."""
    from markupsafe import Markup

    css = (TEMPLATES / "page.css").read_text()
    digest = base64.b64encode(hashlib.sha256(css.encode()).digest()).decode()
    policy = (
        f"default-src 'none'; img-src data:; style-src 'sha256-{digest}'; "
        "base-uri 'none'; form-action 'none'"
    )
    page = _environment().get_template(template)
    return page.render(version=__version__, policy=policy, css=Markup(css), **words)


def data_uri(kind: str, data: bytes) -> str:
    """Return a file as an address that holds it.

    >>> data_uri("image/webp", b"a")
    'data:image/webp;base64,YQ=='
    """
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"


def _uri_of(picture: Plot) -> str:
    return data_uri("image/svg+xml", svg_of(picture.figure))


@cache
def _environment() -> "jinja2.Environment":
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["uri"] = _uri_of
    return environment
