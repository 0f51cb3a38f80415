"""Times as people say them, and what they mean.

All times are seconds since the midnight before the first day, a Monday.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass

DAY_S, HOUR_S = 86_400.0, 3_600.0
PARTS = {"morning": (5.0, 12.0), "afternoon": (12.0, 18.0), "evening": (18.0, 24.0)}
DAYS = ("Monday", "Tuesday", "Wednesday", "Thursday", "Friday", "Saturday", "Sunday")
_PARTS = "|".join(PARTS)
_SPAN = re.compile(
    rf"\b(?:(?P<this>this) (?P<a>{_PARTS})|(?P<yesterday>yesterday)(?: (?P<b>{_PARTS}))?"
    rf"|(?P<today>earlier today|today)|on (?P<day>{'|'.join(DAYS)})(?: (?P<c>{_PARTS}))?)\b",
    re.IGNORECASE,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class SaidSpan:
    """A span of time, and the words for it."""

    words: str
    after_s: float
    before_s: float


def spans(now_s: float, *, days: int = 3) -> Iterator[SaidSpan]:
    """Yield the spans of the last days that people have words for, the latest first."""
    today = int(now_s // DAY_S)
    for back in range(days + 1):
        day = today - back
        if day < 0:
            return
        for part in reversed(PARTS):
            name = ("this", "yesterday")[back] if back < 2 else f"on {DAYS[day % 7]}"
            first, last = PARTS[part]
            after, before = day * DAY_S + first * HOUR_S, day * DAY_S + last * HOUR_S
            if after < now_s:
                yield SaidSpan(words=f"{name} {part}", after_s=after, before_s=min(before, now_s))


def span_of(time_s: float, now_s: float) -> SaidSpan | None:
    """Return the words for the part of the day that a time is in; None if there are none."""
    return next((one for one in spans(now_s) if one.after_s <= time_s <= one.before_s), None)


def read_span(text: str, now_s: float) -> tuple[SaidSpan | None, str]:
    """Return the span that a text speaks of, and the text without its words.

    A weekday is the last one before today.

    >>> span, rest = read_span("the cup that Ann washed this morning", 50_000.0)
    >>> span.after_s, rest
    (18000.0, 'the cup that Ann washed')
    """
    found = _SPAN.search(text)
    if found is None:
        return None, text
    day = int(now_s // DAY_S)
    part = found["a"] or found["b"] or found["c"]
    if found["yesterday"]:
        day -= 1
    elif found["day"]:
        wanted = [name.lower() for name in DAYS].index(found["day"].lower())
        day -= (day - wanted) % 7 or 7
    first, last = PARTS[part.lower()] if part else (0.0, 24.0)
    rest = " ".join((text[: found.start()] + text[found.end() :]).split())
    span = SaidSpan(
        words=found[0],
        after_s=day * DAY_S + first * HOUR_S,
        before_s=min(day * DAY_S + last * HOUR_S, now_s),
    )
    return span, rest.replace(" ?", "?").replace(" ,", ",")
