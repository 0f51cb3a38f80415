"""A program in words that people read before it runs."""

from collections.abc import Iterator, Sequence

from karma.agent.planning.program import DEEDS, WAYS
from karma.household.ids import is_id, type_of
from karma.household.places import HAND
from karma.household.saying import name_of, told_place
from karma.household.types import object_types
from karma.types.planning import SkillCall


def in_words(calls: Sequence[SkillCall]) -> tuple[str, ...]:
    """Return what a program does, in few words each.

    >>> in_words([SkillCall(skill="OpenObject", objects=("Fridge",))])
    ('open the fridge',)
    """
    return tuple(dict.fromkeys(_joined(_deeds(calls))))


def _deeds(calls: Sequence[SkillCall]) -> Iterator[str]:
    """Yield the calls of a program in few words."""
    chosen = [call for call in calls if call.skill not in WAYS] or calls[-1:]
    for call in chosen:
        if call.skill in WAYS:
            yield f"go to {_object_phrase(call.objects[0])}"
        elif call.skill == "PutObject" and call.objects[1:]:
            yield f"put {_object_phrase(call.objects[0])} {told_place(call.objects[-1])}"
        else:
            yield " ".join([DEEDS[call.skill], *dict.fromkeys(map(_object_phrase, call.objects))])


def _joined(deeds: Iterator[str]) -> Iterator[str]:
    """Join switching on with switching the same object off next."""
    last = ""
    for deed in deeds:
        if last.startswith("switch on") and deed == last.replace("switch on", "switch off"):
            last = last.replace("switch on", "switch on and off")
            continue
        yield from filter(None, [last])
        last = deed
    yield from filter(None, [last])


def _object_phrase(name: str) -> str:
    known = type_of(name) in object_types() and name != HAND
    return f"the {name_of(name)}" if known or is_id(name) else name
