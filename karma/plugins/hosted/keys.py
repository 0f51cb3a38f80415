"""Keep the key of a hosted model out of everything that is recorded or shown.

A key stands in one header, and nowhere else. What comes back is searched for it, as it is and in
the disguises that a server could give it: reversed, in base64, base32 or hexadecimal,
percent-encoded, as HTML, rotated by 13, in other case, or cut in pieces. Not found: what needs the
server's own secret to be read, such as encryption.
"""

import base64
import codecs
import html
import re
from collections.abc import Iterator
from functools import cached_property
from typing import Any

HIDDEN = "[key]"  # what stands where a key was
_SHORTEST = 8  # characters; anything shorter is a word such as EMPTY, found in innocent text
_SURE = 16  # letters and digits; shorter ones are not looked for across signs and spaces
_SIGNS = re.compile(r"[^a-z0-9]+")


class Key:
    """A key that shows itself to nobody who prints it, not even as a local variable.

    "" is none, as servers on this machine mostly want; a short one is no secret.
    """

    def __init__(self, text: str = "") -> None:
        self._text = text
        self._hidden = text if len(text) >= _SHORTEST else ""

    def __bool__(self) -> bool:
        return bool(self._text)

    def __repr__(self) -> str:
        return f"Key({HIDDEN!r})" if self._text else "Key()"

    def for_header(self) -> str:
        """Return the key itself."""
        return self._text or "none"

    def out_of(self, value: Any) -> Any:
        """Return a JSON value without the key, wherever in it that stood."""
        if not self._hidden:
            return value
        match value:
            case str():
                return value.replace(self._hidden, HIDDEN)
            case dict():
                return {self.out_of(name): self.out_of(one) for name, one in value.items()}
            case list() | tuple():
                return [self.out_of(one) for one in value]
            case _:
                return value

    def is_disguised_in(self, value: Any) -> bool:
        """Return whether a JSON value holds the key in another form, or in pieces."""
        if not self._hidden:
            return False
        texts = list(_texts(value))
        if any(form in text for text in texts for form in self._exact):
            return True
        if not self._squeezed:
            return False
        whole = "".join((*texts, "\n", *_texts(value, names=False)))  # with names between, without
        for _ in range(2 if "&" in whole else 0):  # twice over, also
            whole = html.unescape(whole)
        squeezed = _squeeze(whole)
        return any(form in squeezed for form in self._squeezed)

    @cached_property
    def _exact(self) -> tuple[str, ...]:
        """Forms that are looked for letter by letter."""
        data = self._text.encode()
        return (self._text[::-1], data.hex(), data.hex().upper(), *_base64(data))

    @cached_property
    def _squeezed(self) -> tuple[str, ...]:
        """Forms that are looked for among letters and digits alone, in any case."""
        if len(_squeeze(self._text)) < _SURE:
            return ()
        plain = (self._text, self._text[::-1], codecs.encode(self._text, "rot13"))
        coded = (base64.b32encode(self._text.encode()).decode().rstrip("="), *self._exact[1:])
        return tuple(map(_squeeze, (*plain, *coded)))


def _base64(data: bytes) -> Iterator[str]:
    """Yield what stays of bytes in base64, wherever in a longer text they began."""
    for before in range(3):
        first = -(-before * 8 // 6)  # letters that hold bits of what came before
        coded = base64.b64encode(bytes(before) + data).decode()
        whole = coded[first : (before + len(data)) * 8 // 6]
        yield whole
        yield whole.replace("+", "-").replace("/", "_")


def _squeeze(text: str) -> str:
    return _SIGNS.sub("", text.lower())


def _texts(value: Any, *, names: bool = True) -> Iterator[str]:
    """Yield all texts of a JSON value in order, with the names in it or without."""
    match value:
        case str():
            yield value
        case dict():
            for name, one in value.items():
                if names:
                    yield name
                yield from _texts(one, names=names)
        case list() | tuple():
            for one in value:
                yield from _texts(one, names=names)
