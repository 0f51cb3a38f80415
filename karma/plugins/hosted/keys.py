"""Keep the key of a hosted model out of everything that is recorded or shown."""

from typing import Any

HIDDEN = "[key]"  # what stands where a key was
_SHORTEST = 8  # characters; anything shorter is a word such as EMPTY, found in innocent text


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
