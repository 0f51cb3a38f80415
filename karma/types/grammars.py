"""Write the language of programs as a grammar, in the Lark notation that llguidance reads.

Grammars of answers use a part of Lark only, which llama.cpp's notation (GBNF) has, too: rules,
quoted texts, groups, `|`, `?`, `{m,n}` and character classes as `/[...]/`. Names of rules that hold
characters alone are in capitals. `start` is the whole answer.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import takewhile
from typing import Protocol

CLOSINGS = ("\n", "```", "#")  # on the line below a call: the program has ended above it
_MAX_POSITIONS = 100  # entries of a list, as the parser admits


def literal(text: str) -> str:
    r"""Return a text as a terminal.

    >>> print(literal('a "b"'))
    "a \"b\""
    """
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    return f'"{escaped}"'


def any_of(words: Sequence[str]) -> str:
    """Return the choice between texts."""
    terminals = " | ".join(map(literal, words))
    return terminals if len(words) == 1 else f"({terminals})"


def lines_grammar(
    line: str, rules: Mapping[str, str], *, max_lines: int, alone: Sequence[str] = ()
) -> str:
    r"""Return the grammar of answers of one to `max_lines` lines, or of one of the lines `alone`.

    An answer may end right after a line, after its newline, or after one of `CLOSINGS` below:
    instruction-tuned models end in all of these ways. `line` is the body of the rule of a line.

    >>> print(lines_grammar('"go(" NAME ")"', {"NAME": '"Mug"'}, max_lines=3))
    start: line ("\n" line){0,2} ("\n" ("\n" | "```" | "#")?)?
    line: "go(" NAME ")"
    NAME: "Mug"
    """
    newline = literal("\n")
    more = f" ({newline} line){{0,{max_lines - 1}}}" if max_lines > 1 else ""
    answers = [f"line{more} ({newline} {any_of(CLOSINGS)}?)?"]
    answers += [f"{literal(text)} {newline}?" for text in alone]
    bodies = {"start": " | ".join(answers), "line": line, **rules}
    return "\n".join(f"{name}: {body}" for name, body in bodies.items())


def without_closing(text: str) -> str:
    r"""Return the lines of an answer, without a closing that only ended it.

    >>> without_closing("GoToObject(robot, 'Mug')\n```\nThis")
    "GoToObject(robot, 'Mug')\n"
    """
    lines = text.splitlines(keepends=True)
    return "".join(takewhile(lambda line: not line.startswith(CLOSINGS), lines))


# ----------------------------------------------------------------- programs


@dataclass(frozen=True, slots=True, kw_only=True)
class Argument:
    """What may stand after a comma: a quoted name, or a list of them in brackets."""

    names: tuple[str, ...]
    most: int = 0  # entries of the list; 0: no list but a single name


@dataclass(frozen=True, slots=True, kw_only=True)
class LineForm:
    """Lines of one form: these skills, and what follows `robot` in them."""

    skills: tuple[str, ...]
    arguments: tuple[Argument, ...]
    needed: int  # how many arguments no line leaves out


class SkillForm(Protocol):
    """A skill, by the arguments that its calls take."""

    @property
    def name(self) -> str:
        """The function's name."""

    @property
    def arguments(self) -> Sequence[str]:
        """The kinds of its arguments: "object" or "positions"."""

    @property
    def optional(self) -> int:
        """How many of the last arguments may be left out."""


class ProgramForms(Protocol):
    """What a program may name; `karma.types.planning.ProgramSpec` is it."""

    @property
    def skills(self) -> Sequence[SkillForm]:
        """The skills that may be called."""

    @property
    def objects(self) -> Sequence[str]:
        """The names of objects."""

    @property
    def positions(self) -> Sequence[str]:
        """The names of area nodes."""

    @property
    def narrowed(self) -> Sequence[tuple[str, Sequence[Sequence[str]]]]:
        """Skills with the names that their first arguments may have."""

    @property
    def max_calls(self) -> int:
        """The most lines."""


def forms(spec: ProgramForms) -> tuple[LineForm, ...]:
    """Return the forms of lines that a spec admits, those of equal arguments together.

    Raises:
        ValueError: a name cannot be quoted, a skill is named twice, or no line is possible.
    """
    for name in (*spec.objects, *spec.positions):
        if not name or not name.isprintable() or "'" in name or "\\" in name:
            raise ValueError(f"{name!r} cannot be written as a quoted name")
    if len({skill.name for skill in spec.skills}) < len(spec.skills):
        raise ValueError("two skills have the same name")
    positions = tuple(dict.fromkeys(spec.positions))
    kinds = {
        "object": Argument(names=tuple(dict.fromkeys(spec.objects))),
        "positions": Argument(names=positions, most=min(len(positions), _MAX_POSITIONS)),
    }
    skills: dict[tuple[tuple[Argument, ...], int], list[str]] = {}
    narrowed = dict(spec.narrowed)
    for skill in spec.skills:
        allowed = narrowed.get(skill.name, ())
        lists = [Argument(names=tuple(dict.fromkeys(names))) for names in allowed]
        arguments = [*lists, *(kinds[kind] for kind in skill.arguments[len(lists) :])]
        needed = len(arguments) - (0 if lists else skill.optional)
        possible = next((n for n, a in enumerate(arguments) if not a.names), len(arguments))
        if possible >= needed:
            skills.setdefault((tuple(arguments[:possible]), needed), []).append(skill.name)
    if not skills or spec.max_calls < 1:
        raise ValueError("this spec admits no program: no skill, no object or no call")
    return tuple(
        LineForm(skills=tuple(names), arguments=arguments, needed=needed)
        for (arguments, needed), names in skills.items()
    )


def program_grammar(spec: ProgramForms, refusals: Sequence[str]) -> str:
    """Return the grammar of programs, or of one of the lines that refuse.

    Raises:
        ValueError: the spec admits no program.
    """
    found = forms(spec)
    lists = list(dict.fromkeys(argument.names for form in found for argument in form.arguments))
    rule_of = {names: f"NAMES{number}" for number, names in enumerate(lists)}

    def written(argument: Argument) -> str:
        name = f"""{literal(", '")} {rule_of[argument.names]}"""
        if not argument.most:
            return name
        more = f"({name}){{0,{argument.most - 1}}} " if argument.most > 1 else ""
        return f"""{literal(", ['")} {rule_of[argument.names]} {more}{literal("]")}"""

    def line(form: LineForm) -> str:
        before = [any_of([f"{skill}(robot" for skill in form.skills])]
        rest: list[str] = []  # an argument that may be left out holds those behind it
        for argument in reversed(form.arguments[form.needed :]):
            rest = [f"({' '.join([written(argument), *rest])})?"]
        needed = map(written, form.arguments[: form.needed])
        return " ".join([*before, *needed, *rest, literal(")")])

    rules = {rule: f'{any_of(names)} "\'"' for names, rule in rule_of.items()}
    lines = " | ".join(map(line, found))
    return lines_grammar(lines, rules, max_lines=spec.max_calls, alone=refusals)
