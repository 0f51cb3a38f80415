"""Effects of a request that later requests of the same text undid."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from karma.agent.body.afterwards import Group, ends_of
from karma.assistant.replies import RequestReply
from karma.household.ids import type_of
from karma.household.pieces import base_type
from karma.types.events import Check, SkillResult

_ACTIONS: Mapping[Group, tuple[str, ...]] = {
    "moved": ("put", "take", "throw"), "switched": ("on", "off"), "doors": ("open", "close"),
}  # fmt: skip


def settled(parts: Sequence[RequestReply]) -> tuple[RequestReply, ...]:
    """Return replies whose checks take into account what a later request undid."""
    found = []
    for number, part in enumerate(parts):
        later = parts[number + 1 :]
        results = [result for reply in later for result in reply.results]
        requested = frozenset[tuple[str, str]]().union(*(reply.requested for reply in later))
        undone = taken_back(part.results, results, part.requested, requested)
        texts = {check.text for check in undone}
        kept = [check for check in part.checks if check.text not in texts]
        found.append(replace(part, checks=(*kept, *undone)) if undone else part)
    return tuple(found)


def taken_back(
    earlier: Sequence[SkillResult],
    later: Sequence[SkillResult],
    own: Collection[tuple[str, str]],
    asked: Collection[tuple[str, str]],
) -> tuple[Check, ...]:
    """Return what later calls undid of earlier calls.

    `own` and `asked` are actions with types of objects, of the first request and of the later
    requests: an effect that was only on the way does not matter, and an effect that a later request
    undoes is meant to be undone.
    """
    before, after = (
        {(end.group, end.name): end for end in ends_of([result.call for result in done], done)}
        for done in (
            [result for result in earlier if result.ok], [result for result in later if result.ok]
        )
    )  # fmt: skip
    found = []
    for key, end in before.items():
        now, kind = after.get(key), base_type(type_of(end.name))
        actions = _ACTIONS.get(end.group, ())
        wanted, meant = (any((action, kind) in some for action in actions) for some in (own, asked))
        if wanted and not meant and now and str(now) != str(end):
            note = f"now it is {str(now).partition(' is ')[2]}"
            found.append(Check(text=str(end), found="otherwise", note=note))
    return tuple(found)
