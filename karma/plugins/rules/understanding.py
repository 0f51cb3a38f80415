"""What a request was understood as, said before anything is done: things, deeds, and how sure.

What it means is read off the planner's own program: a phrase stands for those of the program's
things whose names come nearest to it. What the program uses and the request does not name is said,
and what the request names and the program leaves alone is said, too.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence

from karma.agent.planning.planner import grounded
from karma.agent.planning.refused import sentence
from karma.assistant.program_words import in_words
from karma.assistant.replies import Meant, Understanding
from karma.household.ids import type_of
from karma.household.pieces import base_type
from karma.household.saying import spoken, told_place
from karma.household.types import object_types
from karma.household.uses import KNOB, TAPS, without_basin
from karma.plugins.rules.language.lexicon import ALIKE, Lexicon
from karma.plugins.rules.wording.hints import bare_words, singular
from karma.plugins.rules.wording.phrases import phrases_of
from karma.types.events import Plan
from karma.types.memory import Known
from karma.types.planning import RefusalKind, RefusedRequest, SkillCall

Where = Callable[[str], Known | None]  # of a type or id: where the agent believes it to be
_QUESTIONS: Mapping[RefusalKind, str] = {
    "language": 'Say it in English, please, as in "wash the mug".',
    "negated": "What should I do in its place?",
    "incomplete": "What do you mean by that?",
    "time": "Should I do it now?",
    "question": "Is there something that I should do?",
    "statement": "Is there something that I should do?",
    "condition": "Should I do it anyway?",
    "which": "Which one?",
    "alike": "Will any of them do?",
    "astray": "Say it in other words, please, or one thing at a time.",
    "impossible": "Which other thing or place would do?",
}
_UNNAMED = ("thing", "place", "unclear")  # kinds of refusals whose words name nothing here
_ABILITIES = {
    "on": "switch on", "off": "switch off", "throw": "throw away", "look": "look at under a lamp",
}  # actions in words  # fmt: skip


def understood(
    instruction: str, plan: Plan, where: Where, lexicon: Lexicon, here: Sequence[str]
) -> Understanding:
    """Return what a planner's answer makes of a request.

    `here`: types that the agent knows of in this room.
    """
    sure = sureness(plan)
    if plan.refused is not None:
        return Understanding(
            instruction=instruction,
            sure=sure,
            refused=sentence(plan.refused),
            question=question(plan.refused, instruction, lexicon, here),
            candidates=offered(plan.refused, lexicon, here),
        )
    calls = grounded(plan.calls, plan.names)
    meant, unnamed = _meant(instruction, calls, where, lexicon)
    negated = (verb.text for verb in phrases_of(instruction).verbs if verb.negated)
    return Understanding(
        instruction=instruction,
        meant=meant,
        unnamed=unnamed,
        deeds=in_words(calls),
        forbidden=tuple(dict.fromkeys(negated)),
        sure=sure,
    )


def sureness(plan: Plan) -> str:
    """Return how sure a planner is of its answer, and by which measure; "" where it is not told.

    >>> from karma.types.completion import Certainty, Completion
    >>> from karma.types.planning import Prompt
    >>> said = Completion(text="", finish="stop", prompt_tokens=1, reused_tokens=0,
    ...     completion_tokens=9, first_token_s=None, total_s=0.0,
    ...     certainty=Certainty(mean_logprob=-0.01, least_logprob=-0.1))
    >>> plan = Plan(prompt=Prompt(stable="", changing=""), completion=said, calls=(), names={})
    >>> sureness(plan)
    '0.91 is the chance of the whole answer by the planner (not calibrated)'
    """
    certainty, tokens = plan.completion.certainty, plan.completion.completion_tokens
    if certainty is None:
        return ""
    if tokens is None:
        return f"{math.exp(certainty.mean_logprob):.2f} per token by the planner (not calibrated)"
    whole = math.exp(certainty.mean_logprob * tokens)
    return f"{whole:.2f} is the chance of the whole answer by the planner (not calibrated)"


# ----------------------------------------------------------------- things and deeds


def _meant(
    instruction: str, calls: Sequence[SkillCall], where: Where, lexicon: Lexicon
) -> tuple[tuple[Meant, ...], tuple[str, ...]]:
    """Return the phrases with their things, and the types that no phrase stands for."""
    found = phrases_of(instruction)
    phrases = _noun_phrases(instruction)
    names = {_kind(name): name for call in calls for name in _objects(call)}
    kinds = list(names)
    taken: dict[str, str] = {}  # type -> phrase
    if phrases:
        near = {phrase: lexicon.likeness(phrase, kinds) for phrase in phrases}
        for kind in kinds:
            best = max(phrases, key=lambda phrase: near[phrase][kind])
            if near[best][kind] >= ALIKE:
                taken[kind] = best
    pronoun = next((one.text for one in found.pronouns), "")
    for kind in kinds if pronoun else ():
        if kind not in taken and object_types()[kind].can("pickupable"):
            taken[kind] = pronoun
    meant = {phrase: list[str]() for phrase in phrases}
    for kind in (one for one in kinds if one in taken):
        meant.setdefault(taken[kind], []).append(_thing_and_place(names[kind], where))
    found_meant = tuple(Meant(phrase=one, things=tuple(its)) for one, its in meant.items())
    return found_meant, tuple(spoken(kind) for kind in kinds if kind not in taken)


def _kind(name: str) -> str:
    return without_basin(base_type(type_of(name)))


def _objects(call: SkillCall) -> Iterator[str]:
    """Yield what a call speaks of, no areas and no coordinates."""
    for name in call.objects:
        if type_of(name) in object_types() and type_of(name) != KNOB:
            yield name


def _thing_and_place(name: str, where: Where) -> str:
    """Return a thing with the place where the agent believes it to be."""
    kind, known = _kind(name), where(name)
    fixed = not object_types()[kind].can("pickupable")
    if known is None:
        return kind if fixed else f"{kind}, to be looked for"
    if known.place_id is None:
        return kind
    return f"{kind} {told_place(known.place_id)}"


# ----------------------------------------------------------------- questions


def question(
    refused: RefusedRequest, instruction: str, lexicon: Lexicon, here: Sequence[str]
) -> str:
    """Return what is asked or suggested where a request is not carried out."""
    if refused.kind in _QUESTIONS:
        where = refused.kind == "incomplete" and "where" in refused.words
        return "Where should it go?" if where else _QUESTIONS[refused.kind]
    if refused.kind == "deed":
        return _nearest_deeds(instruction, lexicon)
    if slip := misspelt(refused, lexicon, here):
        return f"Do you mean {slip[1]!r}?"
    return _nearest_things(refused, instruction, lexicon, here)


def misspelt(
    refused: RefusedRequest, lexicon: Lexicon, here: Sequence[str]
) -> tuple[str, str] | None:
    """Return a word that nothing is called by, and what it may be a slip of; None for none."""
    words = refused.words if refused.kind in _UNNAMED else ()
    small = [name for name, kind in object_types().items() if kind.can("pickupable")]
    found = ((one, lexicon.misspelt(one, [*here, *small])) for one in words)
    return next((one for one in found if one[1]), None)


def offered(refused: RefusedRequest, lexicon: Lexicon, here: Sequence[str]) -> tuple[str, ...]:
    """Return what may be meant: things alike, or the types nearest to the words of a refusal."""
    if refused.kind == "which":
        return refused.words
    words = refused.words if refused.kind in _UNNAMED else ()
    return next(filter(None, (_nearest(one, lexicon, here) for one in words)), ())


def _nearest(phrase: str, lexicon: Lexicon, here: Sequence[str]) -> tuple[str, ...]:
    return lexicon.nearest(phrase, [kind for kind in here if kind not in TAPS])


def _nearest_deeds(instruction: str, lexicon: Lexicon) -> str:
    verbs = [verb.text for verb in phrases_of(instruction).verbs]
    near = [_ABILITIES.get(one, one) for verb in verbs[:1] for one in lexicon.deeds(verb)]
    if not near:
        return "I can fetch, put, wash, heat, cool, slice, open, close and switch things."
    return f"What I can do that is nearest to it: {' or '.join(near)}. Is that meant?"


def _nearest_things(
    refused: RefusedRequest, instruction: str, lexicon: Lexicon, here: Sequence[str]
) -> str:
    for phrase in refused.words or _noun_phrases(instruction):
        near = _nearest(phrase, lexicon, here)
        if near and singular(phrase.lower()) not in (near[0].lower(), spoken(near[0]).lower()):
            words = " or ".join(f"the {spoken(kind)}" for kind in near)
            return f"Nearest to {phrase!r} here: {words}. Is one of them meant?"
    return "Which thing do you mean, and where should it go?"


def _noun_phrases(text: str) -> list[str]:
    """Return what a text names, without articles."""
    return [" ".join(bare_words(noun.text.split())) for noun in phrases_of(text).nouns]
