"""What the planner is told: fill the two prompt profiles, nothing else.

`full` follows KARMA Fig. 8 for instruction-tuned models; `compact` says the same in a notation
that a few million parameters can read. Both cut the text at the same place: what stays the same
for a scene first, what changes with each instruction last.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import jinja2

from karma.contracts import Area, MemoryUnit, PlanRequest, Prompt, SkillSignature, Vec3
from karma.errors import UnknownNameError
from karma.household.ids import type_of
from karma.household.pieces import base_type
from karma.household.places import HAND, landmark_types

PROFILES = ("compact", "full")
_ID_REST = re.compile(r"\|[^'\s;,]*")  # what follows the type in an object id
_TEMPLATES = Path(__file__).parent / "prompts"


@dataclass(frozen=True, slots=True, kw_only=True)
class Rendered:
    """A prompt and what its short names stand for (name -> object id)."""

    prompt: Prompt
    names: Mapping[str, str]


def render(profile: str, request: PlanRequest, skills: Sequence[SkillSignature]) -> Rendered:
    """Fill one profile.

    Raises:
        UnknownNameError: no such profile.
    """
    if profile == "compact":
        return compact(request)
    if profile == "full":
        return full(request, skills)
    raise UnknownNameError(f"no prompt profile named {profile!r}. There are: {PROFILES}")


def compact_areas(areas: Sequence[Area]) -> str:
    """Return long-term memory for the compact profile, one line per area; ends in a newline."""
    lines = ["#areas"]
    for area in areas:
        kept = dict.fromkeys(kind for kind in area.contains if kind in landmark_types())
        lines.append(" ".join([area.name, *kept]))
    return "\n".join(lines if areas else ["#areas", "unknown"]) + "\n"


def short_names(units: Sequence[MemoryUnit], held: tuple[str, str] | None) -> dict[str, str]:
    """Give every recalled unit and its place a short name: the last used Apple is `Apple`.

    Args:
        units: the last used last.
        held: (object id, object type) of what is in the hand.

    Returns:
        name -> object id; older things of the same type become `Apple_2`, `Apple_3`, ...
    """
    names: dict[str, str] = {}
    known: set[str] = set()
    things = [(unit.object_id, unit.object_type) for unit in reversed(units)]
    places = [(unit.place_id, type_of(unit.place_id)) for unit in reversed(units)]
    for object_id, object_type in [*([held] if held else []), *things, *places]:
        if object_id is None or object_id == HAND or object_id in known:
            continue
        base = base_type(object_type)
        count = 1
        while (name := base if count == 1 else f"{base}_{count}") in names:
            count += 1
        names[name] = object_id
        known.add(object_id)
    return names


def compact_memory(units: Sequence[MemoryUnit], names: Mapping[str, str]) -> str:
    """Return short-term memory for the compact profile: ` @Fridge cleaned sliced *Apple`.

    What is said of a thing stands before its name: a small model that has found the words it looks
    for reads the name next. `*` is before what was handled, `-` before what was only seen.
    """
    name_of = {object_id: name for name, object_id in names.items()}
    lines = ["#memory\n"]
    for unit in units:
        if unit.place_id is not None:
            lines.append(f" @{name_of.get(unit.place_id, unit.place_id)}")
        lines += [f" {state.replace(' ', '_')}" for state in unit.states]
        lines.append(f" {'*' if unit.handled else '-'}{name_of[unit.object_id]}\n")
    return "".join(lines)


def _compact_last(units: Sequence[MemoryUnit], names: Mapping[str, str]) -> str:
    """Return the line that says what was handled last, which is mostly what "it" means."""
    name_of = {object_id: name for name, object_id in names.items()}
    last = next((unit for unit in reversed(units) if unit.handled), None)
    return f"#last {name_of[last.object_id]}\n" if last is not None else ""


def compact(request: PlanRequest) -> Rendered:
    """Fill the compact profile.

    The task stands before the memory: a small model can then mark what matters while it reads.
    """
    held = (request.held_id, request.held_type) if request.held_id and request.held_type else None
    names = short_names(request.units, held)
    lines = [f"#task {' '.join(request.instruction.lower().split()).rstrip('.!? ')}\n"]
    if request.error:
        lines.append(f"#error {_ID_REST.sub('', ' '.join(request.error.split()))[:120]}\n")
    lines.append(compact_memory(request.units, names))
    lines.append(_compact_last(request.units, names))
    if held is not None:
        lines.append(f"#held {base_type(held[1])}\n")
    lines.append("#program\n")
    prompt = Prompt(stable=compact_areas(request.areas), changing="".join(lines))
    return Rendered(prompt=prompt, names=names)


def full(request: PlanRequest, skills: Sequence[SkillSignature]) -> Rendered:
    """Fill the profile of KARMA Fig. 8."""
    held = (request.held_id, request.held_type) if request.held_id and request.held_type else None
    names = short_names(request.units, held)
    name_of = {object_id: name for name, object_id in names.items()}
    stable = template(_TEMPLATES / "full_stable.txt").render(
        skills=skills, graph=request.graph_text
    )
    changing = template(_TEMPLATES / "full_changing.txt").render(
        units=[(name_of[unit.object_id], unit) for unit in request.units],
        name_of=name_of,
        held=name_of.get(request.held_id or ""),
        error=request.error,
        examples=request.examples,
        instruction=request.instruction,
    )
    return Rendered(prompt=Prompt(stable=stable, changing=changing), names=names)


def position_text(position_m: Vec3) -> str:
    """Return a position to the centimetre.

    >>> position_text((1.0, -0.004, 2.345))
    '[1.00, 0.00, 2.35]'
    """
    return "[" + ", ".join(f"{round(v, 2) + 0.0:.2f}" for v in position_m) + "]"


@cache
def template(path: Path) -> jinja2.Template:
    """Return a prompt's template, read once; what it names and is not given is an error."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(path.parent),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,
    )
    environment.filters["position"] = position_text
    return environment.get_template(path.name)
