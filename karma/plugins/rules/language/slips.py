"""A text as it was meant: without fillers, doubled words, list marks and what was taken back.

"Put the tomato, no wait, the apple in the bowl" is about the apple. Words for things are the text's
own; a form of speech may be said plainly, or stand in the order in which it is to be done.
"""

import re
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path

import msgspec

from karma.files import read_toml
from karma.plugins.rules.language.clock import time_words
from karma.plugins.rules.language.request_words import base_of_deed, is_deed


class _Forms(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The forms of speech as their file has them."""

    fillers: tuple[str, ...]
    taken_back: tuple[str, ...]
    polite: tuple[str, ...]
    leads: tuple[str, ...]
    orders: tuple[str, ...]
    not_served: tuple[str, ...]
    parting: tuple[str, ...]
    asks_to_tell: tuple[str, ...]
    spoken: tuple[tuple[str, str], ...]


FORMS = read_toml(Path(__file__).with_name("spoken.toml"), _Forms)
_SIGNS = str.maketrans(
    {"‘": "'", "’": "'", "“": '"', "”": '"', "…": ".", "–": "-", "—": "-", "\t": " "}
)
_FILLER = re.compile(
    rf"(?<![\w'])(?:{'|'.join(FORMS.fillers)})(?![\w'])[,!.]*(?:\s*\bbut\b)?", re.IGNORECASE
)
_MEANWHILE = ("while", "whilst", "as", "whenever")
_MOST_WHY = 5  # words of "for a quiet night"
_ASKING = re.compile(
    rf"^(?:[^.?!]{{0,60}}?[,:;\s-])??(?:{'|'.join(FORMS.polite)})\b[^.?!]{{0,90}}?"
    rf"(?:{'|'.join(FORMS.leads)}) (?P<rest>\w+\b.*)$",
    re.IGNORECASE,
)
_ROBOT = re.compile(r"^\W*(?:robot|karma)\b(?: listen)?\s*[,:!]*\s*|,\s*robot\b", re.IGNORECASE)
_OTHERWISE = re.compile(
    r"[\s,;.]+(?:otherwise|if not|or else),? (?:just )?(?:leave|keep|let) (?:it|them|that)\b"
    r"[^.;,]*",
    re.IGNORECASE,
)
_DOUBLED = re.compile(r"\b(the|a|an|and|put|it|in|on|to|my|of)(?:\s+\1\b)+", re.IGNORECASE)
_MARK = re.compile(r"(?:^|(?<=[\s.;]))(?:[-*•]|\(?(?:\d{1,2}|[a-h])[.)])\s+(?=[A-Za-z])")
_ORDER = re.compile(
    r"(?:(?<=^)|(?<=[.;,]\s)|(?<=\band\s))(?:first(?:ly)?(?: of all)?|second(?:ly)?|third(?:ly)?"
    r"|last(?:ly)?(?: of all)?|finally|in the end|at the end|afterwards|after that)\b,?\s+",
    re.IGNORECASE,
)
_TAG_QUESTION = re.compile(r"\b(?:would|could|will|can) (?:you|ya)\s*[.?!]*$|,\s*will (?:you|ya)\b")
_TAKEN_BACK = re.compile(
    rf"[\s,.;:-]*[,.;:-]\s*(?:(?:oh|er)[, ]+)?(?:(?:{'|'.join(FORMS.taken_back)})\b[\s,:.-]*)+",
    re.IGNORECASE,
)
_PREPOSITION = r"(?:in|on|into|onto|to|at|under|near|from|beside|next to|inside|behind|off)"
_HAS_PLACE = re.compile(rf"\b{_PREPOSITION}\b", re.IGNORECASE)
_DETERMINER = r"(?:the|a|an|my|your|our|his|her|both|all|every|each|one|two|three|four|that|this)"


_SENTENCE_END = re.compile(r"(?<!\bMr)(?<!\bMrs)(?<!\bMs)(?<!\bDr)[.?!;]+(?=\s)", re.IGNORECASE)


@cache
def _spoken() -> Sequence[tuple[re.Pattern[str], str]]:
    """Return the forms of speech that are said plainly, and what stands for each."""
    return [(re.compile(form, re.IGNORECASE), instead) for form, instead in FORMS.spoken]


def as_meant(text: str, holds: Callable[[str], bool] = bool) -> str:
    r"""Return a text without what people did not mean to say.

    Args:
        text: what is said.
        holds: whether a thing of a name can be where something is put.

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
    for form, instead in _spoken():
        said = form.sub(instead, said)
    said = _OTHERWISE.sub("", _corrected(said, holds))
    said = _ROBOT.sub("", _FILLER.sub(" ", said).strip())
    said = _DOUBLED.sub(r"\1", said)
    said = _ORDER.sub(lambda found: "" if found.start() == 0 else "then ", said)
    said = re.sub(r"\s+", " ", said)
    said = re.sub(r"\s+([,.;:!?])", r"\1", said)
    said = re.sub(r"([.;])(?:\s*[.,;])+", r"\1", said)
    if len(said.split()) > 3:
        said = _TAG_QUESTION.sub("", said)
    return re.sub(r"[\s,]+(?:and|but)([.!?]*)$", r"\1", said).strip(" ,;-")


def _corrected(text: str, holds: Callable[[str], bool]) -> str:
    """Return a text without what is taken back in it."""
    for _ in range(4):
        found = _TAKEN_BACK.search(text)
        if found is None or found.start() == 0:
            return text
        before, after = text[: found.start()], text[found.end() :]
        cut = _cut_back(before, after, holds)
        if cut is None:
            return text
        place = re.search(rf"\b{_PREPOSITION}\b.*", before[cut:], re.IGNORECASE)
        first = re.match(r"[^,.;!?]*", after)
        named = re.match(rf"{_DETERMINER}\b", before[cut:], re.IGNORECASE)
        if named and place and first and not _HAS_PLACE.search(first[0]):
            after = f"{first[0].rstrip()} {place[0]}{after[first.end() :]}"
        after = re.sub(rf"^([^,.;]*),\s*(?={_PREPOSITION}\b)", r"\1 ", after)
        text = f"{before[:cut].rstrip()} {after}"
    return text


def _cut_back(before: str, after: str, holds: Callable[[str], bool]) -> int | None:
    """Return where what is taken back begins: at the word of the kind that the correction has.

    What cannot hold anything stands for no place: "the mug on the desk, I mean the pen".
    """
    name = re.match(rf"{_DETERMINER} (?P<name>[\w ]+?)(?=$|[,.;!?]| {_PREPOSITION} | and )", after)
    for kind in (_PREPOSITION, _DETERMINER):
        if re.match(rf"{kind}\b", after, re.IGNORECASE):
            places = [one.start() for one in re.finditer(rf"\b{kind}\b", before, re.IGNORECASE)]
            behind = re.compile(rf"\b{_PREPOSITION}\s+$", re.IGNORECASE)
            if name and not holds(name["name"].lower()) and kind == _DETERMINER:
                places = [one for one in places if not behind.search(before[:one])] or places
            return places[-1] if places else None
    clause = re.search(r"[.;]\s*[^.;]*$", before)
    return clause.start() + 1 if clause else 0


def sentences_of(text: str) -> list[str]:
    """Return the sentences of a text, each with its end.

    >>> sentences_of("put Mr. Smith's mug in the sink. open the fridge!")
    ["put Mr. Smith's mug in the sink.", 'open the fridge!']
    """
    ends = [found.end() for found in _SENTENCE_END.finditer(text)]
    parts = (text[a:b].strip() for a, b in zip([0, *ends], [*ends, len(text)], strict=True))
    return [part for part in parts if part]


_REMARK = re.compile(
    r"^(?:it(?:'s| is|'ll| will| creates| makes| keeps| helps| gives| looks)|th(?:is|at) way"
    r"|this (?:will|is|makes|keeps|helps)|that(?:'s| is)|they(?:'re| are)"
    r"|(?!(?:some|any|every|no)thing\b)\w+ing\b[^,]*\b(?:will|would|is|makes|helps|can)\b)",
    re.IGNORECASE,
)
_ASKS = re.compile(
    r"n't\b|\b(?:not|never|no|nothing|only|needs?|should|must|ought|please|could you|would you"
    r"|can you|want|(?:is|are|has|have|'s|'re) to|goes?|belongs?|except|but)\b",
    re.IGNORECASE,
)
_LEAD = re.compile(
    r"^(?P<lead>while|whilst|as|when|whenever|after|before|despite|since|for|given)\b"
    r" (?P<body>[^,.;!?]*),\s*(?P<rest>(?:(?:please|kindly|just|then) )*(?P<first>\w+).*)$",
    re.IGNORECASE | re.DOTALL,
)
_MODALS = ("could", "can", "would", "will")


def without_remarks(sentences: Sequence[str]) -> list[str]:
    """Return sentences without those behind the first that only remark on it.

    >>> without_remarks(["Water the plant.", "It's a thirsty one."])
    ['Water the plant.']
    """

    def only_tells(text: str) -> bool:
        late = any(is_deed(word) for word in re.findall(r"[,;] (?:so )?(\w+)", text.lower()))
        return bool(_REMARK.match(text)) and not _ASKS.search(text) and not late

    return [one for number, one in enumerate(sentences) if number == 0 or not only_tells(one)]


def without_lead(sentence: str) -> str:
    """Return a sentence without a clause ahead that tells what its hearer does meanwhile.

    What somebody else does first ("when the guests come") is a time, and stays.

    >>> without_lead("While you tidy up, put the pen away")
    'put the pen away'
    """
    found = _LEAD.match(sentence)
    if found is None:
        return sentence
    lead, words, first = found["lead"].lower(), found["body"].split(), found["first"].lower()
    if not words or not (is_deed(first) or first in _MODALS):
        return sentence
    head = words[0].lower()
    doing = head.endswith("ing")
    yours = head.startswith(("you", "we")) and lead not in ("after", "before", "for")
    yours = yours and words[1:2] not in (["see"], ["spot"], ["notice"], ["come"])  # "the pen"
    why = lead in ("despite", "for", "given") and len(words) <= _MOST_WHY
    told = not any(map(is_deed, words)) and not time_words(f"{lead} {found['body']}")
    meanwhile = yours and (lead in _MEANWHILE or head == "you're" or words[1:2] == ["are"])
    return found["rest"] if meanwhile or (told and (doing or yours or why)) else sentence


def without_courtesy(sentence: str, names: Callable[[str], bool]) -> str:
    """Return what is asked for so politely that it looks like a question or a wish.

    Words that name a thing or a deed may not be left out.

    >>> without_courtesy("would it be possible for you to wash the mug?", lambda words: False)
    'wash the mug'
    """
    found = _ASKING.match(sentence)
    if found is None:
        return sentence
    start = found.start("rest")
    for verb in re.finditer(r"\w+", sentence[start:]):
        begin = start + verb.start()
        led = re.search(r"\b(?:to|and|you|fancy|about|of)\s+$", sentence[:begin], re.IGNORECASE)
        if is_deed(verb[0].lower()) and (led or verb.start() == 0):
            left_out = re.sub(r"^\W*(?:would|could|can|will)\b", "", sentence[:begin])
            return sentence if names(left_out) else sentence[begin:].rstrip(" ?")
    return sentence


def spelt(
    text: str, is_known: Callable[[str], bool], words: Sequence[str], verbs: Sequence[str] = ()
) -> str:
    """Return a text with words that nobody knows spelt as one that is one slip away.

    Args:
        text: what is said.
        is_known: whether a word, in small letters, is one of the language.
        words: that may be meant.
        verbs: of them, those that a sentence may begin with; they are meant rather there.

    >>> spelt("trun on the lamp", lambda word: word != "trun", ["turn", "tap"])
    'turn on the lamp'
    """

    def right(found: re.Match[str]) -> str:
        word = found[0]
        if len(word) < 3 or "'" in word or word[0].isupper() or is_known(word.lower()):
            return word
        begins = re.search(r"(?:^|[.;!?,]\s*)$", text[: found.start()]) is not None
        likely = [*verbs, *words] if begins else words
        return next((one for one in likely if is_a_slip(word.lower(), one)), word)

    return re.sub(r"[A-Za-z]+(?:'[A-Za-z]+)*", right, text)  # "doesn't" is one word


def is_a_slip(word: str, right: str) -> bool:
    """Return whether a word is another with one letter too many, missing, wrong or out of order."""
    if abs(len(word) - len(right)) > 1 or word[0] != right[0]:
        return False
    same = next((n for n, (a, b) in enumerate(zip(word, right, strict=False)) if a != b), None)
    if same is None:
        return len(word) != len(right)
    rest, wanted = word[same:], right[same:]
    swapped = rest[1:2] + rest[:1] + rest[2:]
    return wanted in (swapped, rest[1:]) or rest == wanted[1:] or rest[1:] == wanted[1:]


_NAMED = re.compile(r"\b(?:the|a|an|my)\s+[\w' -]+?(?=$|,| (?:in|on|into|onto|to|from|and|off)\b)")
_FIRST, _LATER = r"(?P<first>[^,.;!?]+?)", r"(?P<later>[^,.;!?]+?)"
_REST = {"first": r"(?P<first>\w+\b[^.;!?]*)", "later": r"(?P<later>\w+\b[^.;!?]*)"}
_HAVING = r"(?:you(?:'ve| have)? |having )?"
_ORDERS = tuple(
    re.compile(form, re.IGNORECASE)
    for form in (
        rf"^before you (?:go and )?{_LATER},\s*{_REST['first']}",
        rf"^(?P<first>[^.;!?]+?),?\s+before (?:you )?{_REST['later']}",
        rf"^(?:after|once|when|as soon as) {_HAVING}{_FIRST},\s*{_REST['later']}",
        rf"^having {_FIRST},\s*{_REST['later']}",
        rf"^(?P<later>[^.;!?]+?),?\s+(?:after|once|when) {_HAVING}{_REST['first']}",
    )
)


def in_order(sentence: str) -> str:
    """Return a sentence with its deeds as they are to be done: what comes first stands first.

    >>> in_order("before you heat the potato, wash it")
    'wash the potato, then heat the potato'
    >>> in_order("heat the potato after washing it")
    'wash the potato, then heat the potato'
    """
    for form in _ORDERS:
        found = form.match(sentence)
        if found is None:
            continue
        first, later = found["first"].strip(), found["later"].strip()
        said = (first, later) if found.start("first") < found.start("later") else (later, first)
        heads = [base_of_deed(text.split()[0].lower()) for text in (first, later)]
        if not all(heads):
            continue
        named = _NAMED.search(said[0])
        rests = (text.split()[1:] for text in (first, later))
        parts = [" ".join((head, *rest)) for head, rest in zip(heads, rests, strict=True)]
        if named is not None:
            parts = [re.sub(r"\b(?:it|them)\b", named[0], part, count=1) for part in parts]
        place = re.search(r"\b(?:in|on|into|onto|to|at|under) (?:the|a|my) [\w' -]+$", parts[1])
        if place is not None and parts[0].endswith(" there"):
            parts[0] = f"{parts[0].removesuffix('there')}{place[0]}"
        end = sentence[found.end() :]
        return f"{parts[0]}, then {parts[1]}{end}"
    return sentence
