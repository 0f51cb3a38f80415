"""Words that speak of a time, wherever they stand."""

import re

DAYS = ("Monday", "Tuesday", "Wednesday", "Thursday", "Friday", "Saturday", "Sunday")
NUMBERS = {
    "one": 1.0, "two": 2.0, "three": 3.0, "four": 4.0, "five": 5.0, "six": 6.0, "seven": 7.0,
    "eight": 8.0, "nine": 9.0, "ten": 10.0, "eleven": 11.0, "twelve": 12.0, "fifteen": 15.0,
    "twenty": 20.0, "thirty": 30.0, "forty": 40.0, "fifty": 50.0, "sixty": 60.0, "ninety": 90.0,
}  # fmt: skip
_COUNTS = ("half a", "half an", "a half", *NUMBERS)
COUNT = rf"(?:\d+|{'|'.join(_COUNTS)}|an?|a few|a couple of)"
_DAY = "|".join(DAYS)
_NOUN = (
    r"(?:seconds|minutes?|mins?|hours?|days?|weeks?|weekends?|months?|years?|nights?|mornings?"
    r"|noon|midday|afternoons?|evenings?|midnight|dawn|dusk|sunrise|sunset|breakfast|lunch|dinner"
    r"|supper|bedtime|christmas|easter|news|january|february|march|april|june|july|august"
    rf"|september|october|november|december|while|moment|{_DAY})"
)
_TIME = re.compile(  # a time's noun after what makes it a time ("the morning paper" is none)
    r"\b(?:(?:(?:last|this|next|these|every|each|all|some|other|in|for|before|after|since|until"
    rf"|till|by|during|at|over|within|on|{COUNT}|few|couple of) (?:the )?)+{_NOUN}"
    rf"(?: (?:ago|before|after|later|morning|afternoon|evening|night|time))?"
    rf"|for a (?:little )?bit|(?:for|in|within|after) {COUNT} second"  # "the second shelf" is none
    rf"|(?:tomorrow|{_DAY})(?: (?:morning|afternoon|evening|night))?|tonight|yesterday|today"
    r"|recently|lately|\d{1,2}[:.]\d{2}|(?:later|ago)(?: on)?"
    rf"|(?:at|by|until|till|before|after) (?:\d{{1,2}}|{'|'.join(NUMBERS)})"
    r"(?: ?(?:am|pm|a\.m\.|p\.m\.|o'clock)\b|(?![:.]?\d| ?\w))"
    r"|(?:until|till)\b(?! (?:it|they)(?: is| are|'s|'re)"
    r" (?:done|hot|warm|cold|clean|cooked|ready))"
    r".*|ago\b.*|since (?:yesterday|then|\d+))\b",
    re.IGNORECASE,
)


def time_words(text: str) -> tuple[tuple[int, int], ...]:
    """Return where words of a text speak of a time, from and to in characters.

    >>> text = "heat the potato for two minutes"
    >>> [text[a:b] for a, b in time_words(text)], time_words("the morning paper")
    (['for two minutes'], ())
    """
    return tuple((found.start(), found.end()) for found in _TIME.finditer(text))
