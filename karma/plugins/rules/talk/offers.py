"""What "yes" would mean where an errand was not carried out, and how answers go on with it."""

import re
from dataclasses import dataclass, replace

from karma.assistant.replies import AgentReply, Understanding
from karma.plugins.rules.language.request import RequestReader
from karma.plugins.rules.language.request_words import request_words
from karma.plugins.rules.types import Request
from karma.types.planning import RefusedRequest

_YES = re.compile(
    r"\W*(?:(?:yes|yeah|yep|yup|sure|ok|okay|right|exactly|correct|please|do|it|so|that|go|ahead"
    r"|of|course|i|thanks)\b\W*)+",
    re.IGNORECASE,
)
_AGREES = re.compile(
    r"\b(?:yes|yeah|yep|yup|sure|ok|okay|exactly|correct|right|please|do it|do that|do so|go ahead"
    r"|of course)\b",
    re.IGNORECASE,
)
_CORRECTS = re.compile(
    r"\W*(?:(?:actually|sorry|oops|oh|wait|but|no|not that(?: one)?)\b[,.! ]*)*"
    r"\b(?:no|not that(?: one)?|i (?:meant|mean|said))\b[,.:! ]*(?P<rest>\S.*)",
    re.IGNORECASE,
)
_COMPLAINTS = {"dirty": "wash", "on": "turn off", "opened": "close", "filled": "empty"}


@dataclass(frozen=True, slots=True, kw_only=True)
class PendingRequest:
    """A request that is not carried out before a question is answered."""

    text: str
    question: str
    candidates: tuple[str, ...] = ()  # object types or ids that the question offers
    about: str = ""  # the words that may mean several objects: "the apple"


def pending(reply: AgentReply) -> PendingRequest | None:
    """Return the request that a reply asks back about, or None if it asks nothing."""
    part = next((one for one in reply.parts if one.status == "asked"), None)
    if part is None:
        return None
    if part.end is not None:
        return PendingRequest(text=part.instruction, question=part.end.text)
    understood = part.understood[-1]
    return PendingRequest(
        text=part.instruction,
        question=understood.question,
        candidates=understood.candidates,
        about=part.about,
    )


def offered(reply: AgentReply) -> str:
    """Return the request that "yes" stands for, or "" if no question of the reply offers one."""
    planned = (one.offer for part in reply.parts for one in part.understood[-1:])
    answered = (part.answer.look for part in reply.parts if part.answer is not None)
    return next(filter(None, (*planned, *answered)), "")


def is_yes(text: str) -> bool:
    """Return whether a text only agrees.

    >>> [is_yes(one) for one in ("yes", "Yes, please do it", "yes, the mug", "no")]
    [True, True, False, False]
    """
    return bool(_YES.fullmatch(text) and _AGREES.search(text))


def is_no(text: str) -> bool:
    """Return whether a text only declines.

    >>> [is_no(one) for one in ("no", "No, thanks.", "no, the mug", "never mind")]
    [True, True, False, True]
    """
    return re.fullmatch(r"\W*(?:(?:no|nope|nah|thanks|thank you|never mind|forget it|leave it"
                        r"|not now|don't)\b\W*)+", text, re.IGNORECASE) is not None  # fmt: skip


def corrected(text: str, last: str, reader: RequestReader) -> str:
    """Return "no, on the desk" and "I meant the cup" as the request before them, corrected.

    `last` is the request that was made last, "" where it was none.
    """
    found = _CORRECTS.match(text) if last else None
    if found is None:
        return text
    whole = any(one.form != "incomplete" for one in reader.read(found["rest"]))
    if whole and found["rest"].lower().split()[0] not in request_words().destinations:
        return text
    return f"{last.rstrip('.!? ')}, no, {found['rest']}"


def with_offer(
    taken: Understanding,
    clause: str,
    refused: RefusedRequest,
    asked: Request,
    slip: tuple[str, str] | None,
) -> Understanding:
    """Return an understanding of a request that is not carried out, with what "yes" would mean.

    `slip` is a word that nothing is called by, and what it may be meant for.
    """
    if refused.kind in ("time", "condition") and asked.errand:
        return replace(taken, offer=asked.errand)
    if refused.kind == "alike":
        marks = "|".join(map(re.escape, refused.words))
        said = re.sub(rf" (?:(?:on|to) the )?(?:{marks})\b(?: one$)?", "", clause)
        return replace(taken, offer=re.sub(r"\bthe same\b", "the", said))
    if slip is not None:
        word, right = slip
        return replace(taken, offer=re.sub(rf"\b{re.escape(word)}\b", right, clause))
    if refused.kind == "statement" and (offer := offer_against(asked)):
        return replace(taken, offer=offer, question=f"Should I {offer}?")
    return taken


def offer_against(told: Request) -> str:
    """Return what would end what a statement tells of one thing: "the plate is filthy"."""
    named = [one for one in told.alone if one.types]
    words = [word.strip(".,!") for word in told.text.lower().split()]
    is_so = {"is", "are", "looks", "'s"} & set(words) and not {"not", "no", "was"} & set(words)
    states = (request_words().seen.get(word, "") for word in words)
    deed = next((_COMPLAINTS[one] for one in states if one in _COMPLAINTS), "")
    return f"{deed} the {named[0].text}" if len(named) == 1 and is_so and deed else ""
