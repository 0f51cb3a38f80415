"""Read a whole list of skills out of a planner's answer; parsed, never executed.

The source splits at commas and strips numbers. Beyond that, lines may end instead of commas,
quotes, bullets, capitals and other articles do not matter. What is no skill is counted as one that
failed, prose before the list too. As in the source, `put down` may go on in any words.
"""

import re
from collections.abc import Iterator, Sequence

LONGEST = 200_000  # characters that are looked at
_MOST = 1_000  # items that are kept
_PUT = "put down "
_SPLIT = re.compile(r"[,;\n]+|\.\s+(?=[a-z])|(?<!step)\s+(?=\d{1,3}[.):])", re.IGNORECASE)
_NUMBERED = re.compile(
    r"^[\s\-*•]*(?:(?:step\s*)?\d+[.):]*\s*)?(?:robot:\s*)?(?:\d+[.):]*\s*)?", re.IGNORECASE
)
_ARTICLE = re.compile(r"\b(?:a|an|the)\s+")

Item = int | str  # a skill's number, or what is no skill


def read_list(text: str, skills: Sequence[str], *, mend: bool = True) -> tuple[Item, ...]:
    """Return the skills of an answer in their order, up to the first that ends the list.

    Args:
        text: as the planner gave it.
        skills: as they are written; the first one ends a list.
        mend: whether it may be written otherwise than in the source.
    """
    written = _plain if mend else str
    known = {written(one): number for number, one in enumerate(skills)}
    puts = [number for number, one in enumerate(skills) if one.startswith(_PUT)]
    found: list[Item] = []
    for said in _items(text[:LONGEST], mend=mend):
        item: Item = known.get(written(said), said)
        if item == said and puts and written(said).startswith(_PUT):
            item = puts[0]  # whatever it names, it is what is held that goes
        found.append(item)
        if item == 0 or len(found) == _MOST:
            break
    return tuple(found)


def _items(text: str, *, mend: bool) -> Iterator[str]:
    if not mend:
        yield from (one.strip(" 1234567890.") for one in text.replace("Robot: ", "").split(","))
        return
    for one in _SPLIT.split(text):
        said = _NUMBERED.sub("", one).strip(" \t\r.'\"`[](){}*")
        if said:
            yield said


def _plain(said: str) -> str:
    """Return a skill without capitals and articles.

    >>> _plain("Find  an Arm chair")
    'find arm chair'
    """
    return " ".join(_ARTICLE.sub("", said.lower()).split())
