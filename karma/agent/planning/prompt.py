"""The prompts for programs: fill the two profiles, nothing else.

`full` follows KARMA Fig. 8 for instruction-tuned models; `compact` says the same in a notation
that a few million parameters can read. Both cut the text at the same place: what stays the same
for a scene first, what changes with each instruction last.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import MappingProxyType

import jinja2

from karma.agent.planning.full_profile import (
    by_place,
    coarse_text,
    doors_and_switches,
    failed_line,
    failed_program,
    fixture_names,
    name_for,
    off_the_map,
    place_name,
    short_names,
    skill_needs,
    stand_ins,
    with_furniture,
)
from karma.agent.planning.program import OUR_SKILLS, SKILLS
from karma.errors import UnknownNameError, did_you_mean
from karma.household.pieces import base_type
from karma.household.places import HAND, landmark_types
from karma.types.memory import Area, MemoryUnit
from karma.types.planning import Hint, PlanRequest, Prompt, Skill

GOALS = "goals"  # the mode in which the model answers goals, see `karma.agent.goal_mode`
TOOLS = "tools"  # the mode in which the model calls tools, see `karma.agent.tools`
PROFILES: Mapping[str, tuple[Skill, ...]] = MappingProxyType(
    {"compact": SKILLS, "full": (*SKILLS, *OUR_SKILLS)}
)  # and the skills that each offers; the nano planner has learnt 13
_ID_REST = re.compile(r"\|[^'\s;,]*")  # what follows the type in an object id

_PROMPTS = Path(__file__).parent / "prompts"
_EXAMPLE = "# Instruction: {}\n# Program (skill calls only)\n"  # as a request ends


@dataclass(frozen=True, slots=True, kw_only=True)
class Rendered:
    """A prompt and what its short names stand for (name -> object id)."""

    prompt: Prompt
    names: Mapping[str, str]


def program_profile(mode: str) -> str:
    """Return the profile in which a method asks for programs, also where the run's mode has none.

    >>> program_profile("compact"), program_profile(GOALS)
    ('compact', 'full')
    """
    return "full" if mode in (GOALS, TOOLS) else mode


def skills_of(profile: str) -> tuple[Skill, ...]:
    """Return the skills that a profile offers; UnknownNameError if there is none of that name."""
    profile = program_profile(profile)
    if profile not in PROFILES:
        hint = did_you_mean(profile, PROFILES)
        raise UnknownNameError(f"no prompt profile named {profile!r}.{hint} {tuple(PROFILES)}")
    return PROFILES[profile]


def check_mode(name: str) -> None:
    """Check the name of a mode: goals, tools, or a profile of programs; UnknownNameError else."""
    if name not in (known := (*dict.fromkeys((*PROFILES, GOALS, TOOLS)),)):
        hint = did_you_mean(name, known)
        raise UnknownNameError(f"no prompt profile named {name!r}.{hint} {known}")


def render(profile: str, request: PlanRequest, *, refusing: bool = False) -> Rendered:
    """Fill a profile; `refusing` explains to a planner without that training how to refuse."""
    skills = skills_of(profile)
    if profile == "compact":
        return compact(request)
    return full(request, skills, refusing=refusing)


def compact_areas(areas: Sequence[Area]) -> str:
    """Return long-term memory for the compact profile, one line per area; ends in a newline."""
    lines = ["#areas"]
    for area in areas:
        kept = dict.fromkeys(kind for kind in area.contains if kind in landmark_types())
        lines.append(" ".join([area.name, *kept]))
    return "\n".join(lines if areas else ["#areas", "unknown"]) + "\n"


_NEVER_TRAINED = frozenset({"cooled"})  # states that no memory of the nano's training had


def compact_memory(units: Sequence[MemoryUnit], name_of: Mapping[str, str]) -> str:
    """Return short-term memory for the compact profile: ` @Fridge cleaned sliced *Apple`.

    What is said of a thing stands before its name: a small model that has found the words it looks
    for reads the name next. `*` is before what was handled, `-` before what was only seen.
    """
    lines = ["#memory\n"]
    for unit in units:
        if unit.place_id is not None:
            lines.append(f" @{name_of.get(unit.place_id, unit.place_id)}")
        told = [state for state in unit.states if state not in _NEVER_TRAINED]
        lines += [f" {state.replace(' ', '_')}" for state in told]
        lines.append(f" {'*' if unit.handled else '-'}{name_of[unit.object_id]}\n")
    return "".join(lines)


def _compact_last(units: Sequence[MemoryUnit], name_of: Mapping[str, str]) -> str:
    """Return the line that says what was handled last, which is mostly what "it" means."""
    last = next((unit for unit in reversed(units) if unit.handled), None)
    return f"#last {name_of[last.object_id]}\n" if last is not None else ""


def compact_words(hints: Sequence[Hint]) -> str:
    """Return what words may mean, in tenths: `#words tumbler: Cup 8 Mug 7; nuke: heat 6`."""
    said = (
        f"{hint.phrase}: " + " ".join(f"{m.name} {tenths(m.similarity)}" for m in hint.meanings)
        for hint in hints
    )
    return f"#words {'; '.join(said)}\n" if hints else ""


def tenths(similarity: float) -> int:
    """Return a cosine as one digit, rounded down.

    >>> tenths(0.79), tenths(1.0), tenths(-0.1)
    (7, 9, 0)
    """
    return min(max(int(similarity * 10), 0), 9)


def compact(request: PlanRequest) -> Rendered:
    """Fill the compact profile.

    The task stands before the memory: a small model can then mark what matters while it reads.
    """
    held = (request.held_id, request.held_type) if request.held_id and request.held_type else None
    names = short_names(request.units, held)
    name_of = {object_id: name for name, object_id in names.items()}
    lines = [f"#task {' '.join(request.instruction.lower().split()).rstrip('.!? ')}\n"]
    lines.append(compact_words(request.hints))
    if request.error:
        lines.append(f"#error {_ID_REST.sub('', ' '.join(request.error.split()))[:120]}\n")
    lines.append(compact_memory(request.units, name_of))
    lines.append(_compact_last(request.units, name_of))
    if held is not None:
        lines.append(f"#held {base_type(held[1])}\n")
    lines.append("#program\n")
    prompt = Prompt(stable=compact_areas(request.areas), changing="".join(lines))
    return Rendered(prompt=prompt, names=names)


def full(request: PlanRequest, skills: Sequence[Skill], *, refusing: bool = False) -> Rendered:
    """Fill the profile of KARMA Fig. 8; worked examples are turns of a chat."""
    held = (request.held_id, request.held_type) if request.held_id and request.held_type else None
    standing = [one for one in request.seen if not one.pickupable and not request.graph_text]
    areas = () if request.graph_text else request.areas
    fixtures = fixture_names(areas, standing, before=request.named)
    told = {unit.object_id: unit.place_id for unit in request.units}
    told |= {request.held_id: HAND} if request.held_id else {}
    movable = [one for one in request.seen if one.pickupable]
    stands_for = stand_ins(movable, told.items())
    seen = [one for one in movable if stands_for[one.object_id] == one.object_id]
    seen = [one for one in seen if one.object_id not in told]
    names = short_names(request.units, held, fixtures=fixtures, seen=seen)
    name_of = {object_id: name for name, object_id in names.items()}
    name_of |= {one: name_of[other] for one, other in stands_for.items()}
    stable = template(_PROMPTS / "full_stable.txt").render(
        skills=skills,
        needs=skill_needs(),
        refusing=refusing,
        graph=request.graph_text,
        areas=[with_furniture(area, fixtures) for area in request.areas],
    )
    changing = template(_PROMPTS / "full_changing.txt").render(
        units=[(name_of[unit.object_id], unit) for unit in request.units],
        place_of=lambda unit: place_name(unit.place_id, name_of),
        seen=by_place(seen, name_of),
        furniture=off_the_map(standing, request.areas, fixtures),
        doors=doors_and_switches([*standing, *seen], name_of),
        held=name_of.get(request.held_id or ""),
        missing=dict.fromkeys(name_for(name, {}) for name in request.missing),
        earlier=dict.fromkeys(failed_line(one, name_of) for one in request.failures[:-1]),
        failed=failed_program(request, name_of),
        whole=request.whole,
        hints=request.hints,
        instruction=request.instruction,
        fields=request.advice.actions,
    )
    turns = tuple(
        (_EXAMPLE.format(example.instruction), example.program) for example in request.examples
    )
    return Rendered(prompt=Prompt(stable=stable, turns=turns, changing=changing), names=names)


@cache
def template(path: Path) -> jinja2.Template:
    """Return the template of a prompt, read once."""
    environment = jinja2.Environment(
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,
    )
    environment.filters["coarse"] = coarse_text
    return environment.from_string(path.read_text(encoding="utf-8"))
