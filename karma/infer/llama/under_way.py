"""Tell of an answer while it comes, and know when its time is up."""

import codecs
from time import perf_counter

from karma.contracts import Heard, Listener
from karma.language.whole import cut_off


class UnderWay:
    """One answer from when it was asked for.

    Args:
        max_seconds: that it may take; None: as long as it likes.
        listen: hears what comes.
    """

    def __init__(self, max_seconds: float | None, listen: Listener | None) -> None:
        self._begun = perf_counter()
        self._most, self._listen = max_seconds, listen
        self._letters = codecs.getincrementaldecoder("utf-8")("replace")
        self._tokens = 0
        self.first_token_s: float | None = None  # None: it has not begun

    @property
    def seconds(self) -> float:
        """Since it was asked for."""
        return perf_counter() - self._begun

    @property
    def is_late(self) -> bool:
        """Whether its time is up."""
        return self._most is not None and self.seconds >= self._most

    @property
    def late(self) -> str:
        """Say that its time was up."""
        return cut_off(seconds=self._most or 0)

    def begins(self) -> None:
        """Note that the first token of the answer is there, a thought before it not counted."""
        if self.first_token_s is None:
            self.first_token_s = self.seconds

    def came(self, piece: bytes, tokens: int = 1) -> None:
        """Note so many tokens, which append so much to the text; half letters wait for the rest."""
        self._tokens += tokens
        if self._listen is not None:
            text = self._letters.decode(piece)
            self._listen(Heard(text=text, tokens=self._tokens, seconds=self.seconds))
