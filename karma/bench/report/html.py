"""Pages out of templates: all text escaped, scripts and styles our own, nothing fetched."""

import base64
import hashlib
import json
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from karma import __version__
from karma.agent.planning.refused_requests import sentence
from karma.household.ids import type_of

if TYPE_CHECKING:
    import jinja2

TEMPLATES = Path(__file__).parent


def fill(
    template: str, *, script: str = "replay.js.j2", columns: int = 1, letters: int = 1, **words: Any
) -> str:
    """Return a page.

    `columns` are those of the list of tasks, one a row of the experiment; `letters` are of the
    longest task's name. `words` are what the template says.
    """
    environment = _environment()
    css = environment.get_template("page.css.j2").render(columns=columns, letters=letters)
    code = environment.get_template(script).render()
    return environment.get_template(template).render(
        version=__version__,
        policy=_policy(css, code),
        css=_trusted(css),
        script=_trusted(code),
        **words,
    )


def script_data(value: Any) -> Any:
    """Return data for a script element, which no text in it can end."""
    text = json.dumps(value, ensure_ascii=False, separators=(",", ":"))
    for letter in "<>&":
        text = text.replace(letter, f"\\u{ord(letter):04x}")
    return _trusted(text)


def data_uri(kind: str, data: bytes) -> str:
    """Return a file as an address that holds it.

    >>> data_uri("image/webp", b"a")
    'data:image/webp;base64,YQ=='
    """
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"


def _policy(css: str, script: str) -> str:
    """Return what a browser may do with the page: show it, run its own script, fetch nothing."""
    return (
        f"default-src 'none'; img-src data:; style-src {_hash(css)}; script-src {_hash(script)}; "
        "base-uri 'none'; form-action 'none'"
    )


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def _trusted(text: str) -> Any:
    from markupsafe import Markup

    return Markup(text)  # ours, or escaped for where it stands


@cache
def _environment() -> "jinja2.Environment":
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["short"] = type_of
    environment.filters["told"] = sentence
    return environment
