"""Pages out of templates: all text escaped; scripts, styles, pictures our own, nothing fetched."""

import base64
import hashlib
import io
import json
from collections.abc import Callable, Hashable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from karma import __version__
from karma.agent.planning.refusal_text import sentence
from karma.contracts import Frame
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


QUALITY = 72  # of WebP: about 3 kB for 300 x 300 pixels of a drawn room


class Frames:
    """Pictures in the order they were first seen; equal ones share a number."""

    def __init__(self) -> None:
        self._numbers: dict[bytes, int] = {}
        self._seen: dict[Hashable, int] = {}
        self._webp: list[Future[bytes]] = []
        self._packing = ThreadPoolExecutor(1)  # while the next one is drawn

    def of(self, moment: Hashable, draw: Callable[[], Frame | None]) -> int:
        """Return the number of a moment's picture, drawn if no equal moment was; -1 without one."""
        if moment not in self._seen:
            frame = draw()
            self._seen[moment] = -1 if frame is None else self.add(frame)
        return self._seen[moment]

    def add(self, frame: Frame) -> int:
        """Keep a picture; returns its number."""
        key = hashlib.blake2b(frame.tobytes(), digest_size=16).digest()
        if key not in self._numbers:
            self._numbers[key] = len(self._webp)
            self._webp.append(self._packing.submit(webp, frame.copy()))
        return self._numbers[key]

    def __len__(self) -> int:
        """Return the number of different pictures."""
        return len(self._webp)

    def uris(self) -> list[str]:
        """Return each as a data URI."""
        return [data_uri("image/webp", one.result()) for one in self._webp]


def webp(frame: Frame) -> bytes:
    """Return a picture as a WebP file; equal pictures give equal bytes."""
    from PIL import Image

    file = io.BytesIO()
    Image.fromarray(frame).save(file, "WEBP", quality=QUALITY, method=4)
    return file.getvalue()
