"""Times as people say them, and what they mean.

All times are seconds since the midnight before the first day, a Monday.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass

DAYS = ("Monday", "Tuesday", "Wednesday", "Thursday", "Friday", "Saturday", "Sunday")
NUMBERS = {
    "one": 1.0, "two": 2.0, "three": 3.0, "four": 4.0, "five": 5.0, "six": 6.0, "seven": 7.0,
    "eight": 8.0, "nine": 9.0, "ten": 10.0, "eleven": 11.0, "twelve": 12.0, "fifteen": 15.0,
    "twenty": 20.0, "thirty": 30.0, "forty": 40.0, "fifty": 50.0, "sixty": 60.0, "ninety": 90.0,
}  # fmt: skip
_HALVES = ("half a", "half an", "a half")
_COUNT = rf"(?:\d+|{'|'.join((*_HALVES, *NUMBERS))}|an?|a few|a couple of)"
_DAY = "|".join(DAYS)
_NOUN = (
    r"(?:seconds|minutes?|mins?|hours?|days?|weeks?|weekends?|months?|years?|nights?|mornings?"
    r"|noon|midday|afternoons?|evenings?|midnight|dawn|dusk|sunrise|sunset|breakfast|lunch|dinner"
    r"|supper|bedtime|christmas|easter|news|january|february|march|april|june|july|august"
    rf"|september|october|november|december|while|moment|{_DAY})"
)
_TIME = re.compile(  # a time's noun after what makes it a time ("the morning paper" is none)
    r"\b(?:(?:(?:last|this|next|these|every|each|all|some|other|in|for|before|after|since|until"
    rf"|till|by|during|at|over|within|on|{_COUNT}|few|couple of) (?:the )?)+{_NOUN}"
    rf"(?: (?:ago|before|after|later|morning|afternoon|evening|night|time))?"
    rf"|for a (?:little )?bit|(?:for|in|within|after) {_COUNT} second"  # "the second shelf" is none
    rf"|(?:tomorrow|{_DAY})(?: (?:morning|afternoon|evening|night))?|tonight|yesterday|today"
    r"|recently|lately|\d{1,2}[:.]\d{2}|(?:later|ago)(?: on)?"
    rf"|(?:at|by|until|till|before|after) (?:\d{{1,2}}|{'|'.join(NUMBERS)})"
    r"(?: ?(?:am|pm|a\.m\.|p\.m\.|o'clock)\b|(?![:.]?\d| ?\w))"
    r"|(?:until|till)\b(?! (?:it|they)(?: is| are|'s|'re)"
    r" (?:done|hot|warm|cold|clean|cooked|ready))"
    r".*|ago\b.*|since (?:yesterday|then|\d+))\b",
    re.IGNORECASE,
)
DAY_S, HOUR_S = 86_400.0, 3_600.0
PARTS = {"morning": (5.0, 12.0), "afternoon": (12.0, 18.0), "evening": (18.0, 24.0)}
_PART = "|".join(PARTS)
_SPAN = re.compile(
    rf"\b(?:(?P<this>this) (?P<a>{_PART})|(?P<before>the day before yesterday)"
    rf"|(?P<yesterday>yesterday)(?: (?P<b>{_PART}))?|(?P<night>last night)"
    rf"|(?P<count>{_COUNT}) (?P<unit>minute|hour|day|week)s? ago"
    rf"|(?:(?:in|over|during|within|for) )?(?:the (?:last|past) (?:(?P<last>{_COUNT}) )?"
    rf"|(?:last|past) (?P<lasts>{_COUNT}) )(?P<lasting>minute|hour|day|week)s?"
    rf"|(?P<today>earlier today|today)|(?:on )?(?:last )?(?P<day>{_DAY})s?(?: (?P<c>{_PART}))?"
    rf"|(?:at|around|about) (?:(?P<noon>noon|midday|midnight)"
    rf"|(?P<hour>\d\d?|{'|'.join(NUMBERS)})(?:[:.](?P<minute>\d\d))?"
    rf"(?: ?(?P<half>am|pm|a\.m\.|p\.m\.|o'clock)\b)?)"
    rf"(?: (?P<day_of>today|yesterday))?)\b",
    re.IGNORECASE,
)
_UNIT_S = {"minute": 60.0, "hour": HOUR_S, "day": DAY_S, "week": 7 * DAY_S}


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
    ends = _ends(found, now_s) if found is not None else None
    if found is None or ends is None:
        return None, text
    rest = " ".join((text[: found.start()] + text[found.end() :]).split())
    span = SaidSpan(words=found[0], after_s=ends[0], before_s=min(ends[1], now_s))
    return span, rest.replace(" ?", "?").replace(" ,", ",")


def time_of_day(now_s: float) -> str:
    """Return a time in words.

    >>> time_of_day(8.5 * HOUR_S), time_of_day(DAY_S)
    ('Monday 8:30', 'Tuesday 0:00')
    """
    day, second = divmod(int(now_s), int(DAY_S))
    return f"{DAYS[day % 7]} {second // 3600}:{second % 3600 // 60:02}"


def time_words(text: str) -> tuple[tuple[int, int], ...]:
    """Return where words of a text speak of a time, from and to in characters.

    >>> text = "heat the potato for two minutes"
    >>> [text[a:b] for a, b in time_words(text)], time_words("the morning paper")
    (['for two minutes'], ())
    """
    return tuple((found.start(), found.end()) for found in _TIME.finditer(text))


def unread_times(text: str) -> tuple[str, ...]:
    """Return the words of a text that speak of a time, for a text whose span was taken out.

    >>> unread_times("the cup that Ann washed after dinner"), unread_times("the cup")
    (('after dinner',), ())
    """
    return tuple(text[begin:end].strip() for begin, end in time_words(text))


def _ends(said: re.Match[str], now_s: float) -> tuple[float, float] | None:
    """Return when a span begins and ends; None if it is not yet, or no time of the day."""
    day = int(now_s // DAY_S)
    if said["unit"]:
        return _ago(said["count"].lower(), _UNIT_S[said["unit"].lower()], now_s)
    if said["lasting"]:
        unit_s = _UNIT_S[said["lasting"].lower()]
        count = _count((said["last"] or said["lasts"] or "one").lower())
        return (now_s - count * unit_s, now_s) if count else None
    if said["night"]:
        return (day - 1) * DAY_S + PARTS["evening"][0] * HOUR_S, day * DAY_S + 5 * HOUR_S
    if said["noon"] or said["hour"]:
        return _at(said, now_s)
    part = said["a"] or said["b"] or said["c"]
    if said["yesterday"]:
        day -= 1
    elif said["before"]:
        day -= 2
    elif said["day"]:
        wanted = [name.lower() for name in DAYS].index(said["day"].lower())
        day -= (day - wanted) % 7 or 7
    first, last = PARTS[part.lower()] if part else (0.0, 24.0)
    after_s = day * DAY_S + first * HOUR_S
    return (after_s, day * DAY_S + last * HOUR_S) if after_s < now_s else None


def _ago(count: str, unit_s: float, now_s: float) -> tuple[float, float] | None:
    """Return what "two days ago" covers: that day, or half a unit about that time."""
    number = _count(count)
    if not number:
        return None
    if unit_s >= DAY_S:
        day = int(now_s // DAY_S) - int(number * unit_s / DAY_S)
        return day * DAY_S, (day + 1) * DAY_S
    about = min(number, 1.0) * unit_s / 2
    return now_s - number * unit_s - about, now_s - number * unit_s + about


def _count(word: str) -> float:
    """Return what a count means; 0 where it is none: "a few"."""
    if word in ("a few", "a couple of"):
        return 0.0
    return 0.5 if word in _HALVES else _number(word)


def _at(said: re.Match[str], now_s: float) -> tuple[float, float] | None:
    """Return the half hour before and after a time of the day, the last one that has been."""
    hours = _hour(said)
    if hours is None:
        return None
    day = int(now_s // DAY_S) - ((said["day_of"] or "").lower() == "yesterday")
    times = [day * DAY_S + one * HOUR_S for one in hours]
    if not said["day_of"]:
        times += [one - DAY_S for one in times]
    been = [one for one in times if one <= now_s]
    return (max(been) - HOUR_S / 2, max(been) + HOUR_S / 2) if been else None


def _hour(said: re.Match[str]) -> tuple[float, ...] | None:
    """Return the hours that a time may mean: "at seven" is in the morning or the evening."""
    if said["noon"]:
        return (0.0,) if said["noon"].lower() == "midnight" else (12.0,)
    hour = _number(said["hour"].lower())
    if hour > 24:
        return None
    hour += float(said["minute"] or 0) / 60
    half = (said["half"] or "").lower()[:1]
    if half in ("a", "p"):
        return (hour % 12 + 12 * (half == "p"),)
    return (hour,) if hour > 12 else (hour % 24, (hour + 12) % 24)


def _number(word: str) -> float:
    return float(word) if word.isdigit() else NUMBERS.get(word, 1.0)
