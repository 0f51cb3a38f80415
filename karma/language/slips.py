"""A text as it was meant to be said: without fillers, doubled words, list marks and what was taken
back ("the tomato, no wait, the apple").

What is left out is only left out: every letter that stays is the text's own, in its order.
"""

import re

_SIGNS = str.maketrans(
    {"‘": "'", "’": "'", "“": '"', "”": '"', "…": ".", "–": "-", "—": "-", "\t": " "}
)
_FILLER = re.compile(
    r"(?<![\w'])(?:u+m+|u+h+|e+r+m?|hm+|pls|plz|please|kindly|thanks(?: a lot)?|thank you|thx|ta|cheers|mate"
    r"|dear|buddy|hey|hi|hello|ok|okay|alright|listen|well then|you know|i mean,? like)(?![\w'])[,!.]*",
    re.IGNORECASE,
)
_ROBOT = re.compile(r"^\W*(?:robot|karma)\b(?: listen)?\s*[,:!]*\s*|,\s*robot\b", re.IGNORECASE)
_OTHERWISE = re.compile(
    r"[\s,;.]+(?:otherwise|if not|or else),? (?:just )?(?:leave|keep|let) (?:it|them|that)\b[^.;,]*",
    re.IGNORECASE,
)
_DOUBLED = re.compile(r"\b(the|a|an|and|put|it|in|on|to|my|of)(?:\s+\1\b)+", re.IGNORECASE)
_MARK = re.compile(r"(?:^|(?<=[\s.;]))(?:[-*•]|\(?(?:\d{1,2}|[a-h])[.)])\s+(?=[A-Za-z])")
_ORDER = re.compile(
    r"(?:(?<=^)|(?<=[.;,]\s)|(?<=\band\s))(?:first(?:ly)?(?: of all)?|second(?:ly)?|third(?:ly)?|last(?:ly)?"
    r"(?: of all)?|finally|in the end|at the end|afterwards|after that)\b,?\s+",
    re.IGNORECASE,
)
_TAKEN_BACK = re.compile(
    r"[\s,.;:-]*[,.;:-]\s*(?:(?:oh|er)[, ]+)?(?:no[, ]+(?:wait|sorry|not that|actually)|no|wait|sorry|oops|i mean"
    r"|or rather|rather|i meant|scratch that|correction|actually,?\s+make (?:that|it)|make (?:that|it)"
    r"|actually,?\s+no)\b[\s,:.-]*",
    re.IGNORECASE,
)
_PREPOSITION = r"(?:in|on|into|onto|to|at|under|near|from|beside|next to|inside|behind|off)"
_DETERMINER = r"(?:the|a|an|my|your|our|his|her|both|all|every|each|one|two|three|four|that|this)"


def as_meant(text: str) -> str:
    r"""Return a text without what people did not mean to say.

    >>> as_meant("put the tomato, no wait, the apple into the fridge")
    'put the apple into the fridge'
    >>> as_meant("um could you uh take the the mug, please")
    'could you take the mug'
    >>> as_meant("1) wash the plate\n2) put it on the table")
    'wash the plate. put it on the table'
    """
    said = text.translate(_SIGNS).replace("...", ", ")
    if said.upper() == said:
        said = said.lower()
    said = re.sub(r"\s*[\r\n\v\f\x85\u2028\u2029]+\s*", ". ", said.strip())
    said = _MARK.sub(lambda mark: "" if mark.start() == 0 else ". ", said)
    said = _OTHERWISE.sub("", _corrected(said))
    said = _ROBOT.sub("", _FILLER.sub(" ", said).strip())
    said = _DOUBLED.sub(r"\1", said)
    said = _ORDER.sub(lambda found: "" if found.start() == 0 else "then ", said)
    said = re.sub(r"\s+", " ", said)
    said = re.sub(r"\s+([,.;:!?])", r"\1", said)
    said = re.sub(r"([.;])(?:\s*[.,;])+", r"\1", said)
    said = (
        re.sub(r"\b(?:would|could|will|can) you\s*[.?!]*$|,\s*will you\b", "", said)
        if len(said.split()) > 3
        else said
    )
    return said.strip(" ,;-")


def _corrected(text: str) -> str:
    """Return a text without what is taken back in it."""
    for _ in range(4):
        found = _TAKEN_BACK.search(text)
        if found is None or found.start() == 0:
            return text
        before, after = text[: found.start()], text[found.end() :]
        cut = _cut_back(before, after)
        if cut is None:
            return text
        after = re.sub(rf"^([^,.;]*),\s*(?={_PREPOSITION}\b)", r"\1 ", after)
        text = f"{before[:cut].rstrip()} {after}"
    return text


def _cut_back(before: str, after: str) -> int | None:
    """Return where what is taken back begins: at the word of the kind that the correction has."""
    for kind in (_PREPOSITION, _DETERMINER):
        if re.match(rf"{kind}\b", after, re.IGNORECASE):
            places = [one.start() for one in re.finditer(rf"\b{kind}\b", before, re.IGNORECASE)]
            return places[-1] if places else None
    clause = re.search(r"[.;]\s*[^.;]*$", before)
    return clause.start() + 1 if clause else 0
