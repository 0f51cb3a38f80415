"""Write LoTa-Bench's skills: 214 sentences in natural words, the same in every room.

The source lists what can be found in the order of a Python set, which is another in every process;
here it is that of EB-ALFRED's numbers. `put down` names a thing, but it is what is held that goes.
"""

from collections.abc import Iterator, Sequence

from karma.household.types import in_words
from karma.world.eb_alfred.actions import ActionTypes, NumberedAction, Verb

DONE = "done"
_AS_IT_STANDS = ("CD",)  # in the source


def skills_of(types: ActionTypes) -> tuple[NumberedAction, ...]:
    """Return all skills; the number of each is its place."""
    return (NumberedAction(verb="done", written=DONE), *_skills(types))


def _skills(types: ActionTypes) -> Iterator[NumberedAction]:
    yield from _of("find", types.objs)
    for kind in types.pick_obj:
        yield from (_skill("pick up", kind), _skill("put", kind))
    for kind in types.open_obj:
        yield from (_skill("open", kind), _skill("close", kind))
    yield from _of("slice", types.slice_obj)
    for kind in types.toggle_obj:
        yield from (_skill("turn on", kind), _skill("turn off", kind))


def _of(verb: Verb, kinds: Sequence[str]) -> Iterator[NumberedAction]:
    yield from (_skill(verb, kind) for kind in kinds)


def _skill(verb: Verb, kind: str) -> NumberedAction:
    words = kind if kind in _AS_IT_STANDS else in_words(kind)
    article = "the" if verb != "find" else "an" if words[0] in "aeiou" else "a"
    said = "put down" if verb == "put" else verb
    return NumberedAction(verb=verb, noun=kind, written=f"{said} {article} {words}")
