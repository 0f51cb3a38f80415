"""Word the refusal of a request for people."""

from collections.abc import Mapping

from karma.types.planning import RefusalKind, RefusedRequest

_WITH_WORDS: Mapping[RefusalKind, str] = {
    "deed": "I have no skill for {words}.",
    "thing": "I know of no {words} in a home.",
    "place": "I know of no {words} in this home.",
    "impossible": "That cannot be done: {words}.",
    "unclear": "I am not sure what is meant by {words}.",
    "time": "I cannot wait: {words}. I do things at once or not at all.",
    "condition": "I cannot tell whether that is so: {words}.",
    "alike": "I know of more than one, and cannot tell which is meant by {words}.",
}
_ALONE: Mapping[RefusalKind, str] = {
    "deed": "I have no skill for that.",
    "thing": "I know of no such thing in a home.",
    "place": "I know of no such place in this home.",
    "language": "I understand English only, and could not read this.",
    "negated": "That says only what not to do, so I do nothing.",
    "impossible": "That cannot be done with these things, or would do harm.",
    "unclear": "I am not sure what is meant.",
    "time": "I cannot wait; I do things at once or not at all.",
    "condition": "I cannot tell whether that is so.",
    "question": "That is a question; I do nothing for one, and cannot answer it yet.",
    "statement": "That asks for nothing, and I have kept nothing of it.",
    "incomplete": "Something is missing.",
    "astray": "I would not have done what was said.",
    "which": "That cannot be taken back, and I know of more than one.",
    "alike": "I know of more than one, and cannot tell which is meant.",
}


def sentence(refused: RefusedRequest) -> str:
    """Return the sentence that tells a person why a request is not carried out.

    >>> sentence(RefusedRequest(kind="thing", words=("hammer",)))
    "I know of no 'hammer' in a home."
    """
    if refused.kind == "astray":
        return f"I would not have done what was said: {', '.join(refused.words)}."
    if refused.kind == "which":
        return f"That cannot be taken back, and I know of {' and '.join(refused.words)}."
    if refused.kind == "place" and refused.by == "guard":
        return f"There is no {refused.words[0]!r} here that I know of."
    form = _WITH_WORDS.get(refused.kind) if refused.words else None
    if form is None:
        return _ALONE[refused.kind]
    quoted = refused.words if refused.by == "inspector" else map(repr, refused.words)
    return form.format(words=" or ".join(quoted))
