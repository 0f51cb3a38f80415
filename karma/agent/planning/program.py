"""The skill API of KARMA's Listing 2, and its parser: a planner's text becomes data, never code.

A program is a straight line of skill calls, `Skill(robot, 'Name', ...)`; or one line stands for it
that says why the request is not carried out, `refuse('KIND')`. Nothing is executed: the text is
read with `ast`, matched against the signatures, and refused otherwise.
"""

import ast
import re
import textwrap
import warnings
from collections.abc import Sequence
from difflib import get_close_matches
from typing import Literal

from karma.errors import ProgramError
from karma.household.skill_effects import SKILL_EFFECTS
from karma.types.planning import REFUSAL_KINDS, Skill, SkillCall
from karma.types.space import Vec3

MAX_LINES = 200
MAX_CHARACTERS = 20_000
MAX_NAME = 100
MAX_POSITIONS = 100
MAX_METRES = 1000.0


def _skill(
    name: str,
    doc: str,
    deed: str = "",
    cannot: str = "",
    needs: str = "",
    action: str = "",
    arguments: tuple[Literal["object", "positions"], ...] = ("object",),
    optional: int = 0,
) -> Skill:
    return Skill(
        name=name, arguments=arguments, optional=optional, doc=doc, deed=deed,
        takes=SKILL_EFFECTS[name].takes, cannot=cannot, needs=needs,
        action=action or (name if deed else ""),
    )  # fmt: skip


_ON, _OFF = "ToggleObjectOn", "ToggleObjectOff"
SKILLS: tuple[Skill, ...] = (
    _skill(
        "GoToObject", "Navigate to an object whose place is known.", needs="Go to a known thing."
    ),
    _skill(
        "PickupObject", "Pick up the object; it must be in view and the hand empty.", "take",
        "cannot be picked up", "The hand must be empty, and open what the thing is in.",
    ),
    _skill(
        "PutObject", "Put the held object (first) into or onto the receptacle (second).", "put",
        arguments=("object", "object"), optional=1,
        needs="Put what is held (first) into or onto a receptacle (second). Open a {shut} first. "
        "These take nothing else: {picky}.",
    ),
    _skill(
        "SwitchOn", "Turn on a switch, lamp or tap.", "switch on", "cannot be switched",
        "As ToggleOn.", _ON,
    ),
    _skill(
        "SwitchOff", "Turn off a switch, lamp or tap.", "switch off", "cannot be switched",
        "As ToggleOff.", _OFF,
    ),
    _skill(
        "OpenObject", "Open a fridge, cabinet, drawer, microwave or box that is closed.",
        "open", "cannot be opened", "A Microwave must be off.",
    ),
    _skill(
        "CloseObject", "Close an object that is open.", "close", "cannot be closed",
        "Close what is open.",
    ),
    _skill(
        "BreakObject", "Break the object.", "break", "cannot be broken",
        "A broken {egg} is cracked, and still named {egg}.",
    ),
    _skill(
        "SliceObject", "Slice the object, e.g. an apple, tomato or bread.", "slice",
        "cannot be sliced", "Hold a {knives}. Cuts {sliceable}; then its name means a slice.",
    ),
    _skill(
        "ThrowObject", "Throw away the held object.", "throw",
        needs="Throw what is held across the room. To throw a thing away, put it into the "
        "GarbageCan.",
    ),
    _skill(
        "Explore", "Search the positions in the given order until the object is visible.",
        arguments=("object", "positions"), optional=1,
        needs="Go to a thing if its place is known; else search these positions, then all "
        "others. What it opens stays open.",
    ),
    _skill(
        "ToggleOn", "Toggle on a lamp, stove, microwave, toaster or tap.",
        "switch on", "cannot be switched",
        "Switch on a lamp, tap, StoveBurner, Microwave (closed) ...; Sink is its tap.", _ON,
    ),
    _skill(
        "ToggleOff", "Toggle off the object.", "switch off", "cannot be switched",
        "Switch off what is on.", _OFF,
    ),
)  # fmt: skip
"""The 13 functions of Listing 2. `PutObject` with one object means the receptacle."""

OUR_SKILLS: tuple[Skill, ...] = (
    _skill(
        "EmptyObject", "Pour out what the object is filled with.", "empty", "holds no liquid",
        "Pour out what is in it.", "EmptyLiquidFromObject",
    ),
    _skill(
        "PutNear", "Put the held object (first) near another thing (second), on what that lies on.",
        "put near", arguments=("object", "object"), action="PutObject",
        needs="Put what is held (first) within {near_m} m of a thing or '(x, y, z)' (second).",
    ),
)  # fmt: skip
"""Two more of ours: nothing in Listing 2 gets the water out of a mug, or one thing near another."""

SKILL_OF = {skill.name: skill for skill in (*SKILLS, *OUR_SKILLS)}
DEEDS = {skill.name: skill.deed for skill in SKILL_OF.values() if skill.deed}
STATE_AFTER = {name: effect.adds[0] for name, effect in SKILL_EFFECTS.items() if effect.adds}
SWITCH_AFTER = {name: state for name, state in STATE_AFTER.items() if state in ("on", "off")}
DOOR_AFTER = {name: state for name, state in STATE_AFTER.items() if state in ("opened", "closed")}
CHANGES = {
    name: state for name, state in STATE_AFTER.items() if state in ("sliced", "broken", "empty")
}
UNDONE_BY = {"OpenObject": "CloseObject", _ON: "ToggleOff"}  # AI2-THOR's action -> skill
WAYS = tuple(skill.name for skill in SKILL_OF.values() if not skill.deed)  # only get somewhere
PUTS = ("PutObject", "PutNear")  # skills that empty the hand, by what they say first

_NAME = re.compile(r"[\w|+\-.,()/& ]+")
_FENCE = re.compile(r"\s*```[ \t]*[A-Za-z0-9_+-]*[ \t]*")
_STATEMENTS = {
    ast.Assign: "an assignment", ast.AnnAssign: "an assignment", ast.AugAssign: "an assignment",
    ast.For: "a loop", ast.AsyncFor: "a loop", ast.While: "a loop", ast.If: "a condition",
    ast.Import: "an import", ast.ImportFrom: "an import", ast.FunctionDef: "a definition",
    ast.AsyncFunctionDef: "a definition", ast.ClassDef: "a definition", ast.Pass: "pass",
    ast.Try: "a try block", ast.With: "a with block", ast.Return: "a return",
}  # fmt: skip


def parse_program(text: str, skills: Sequence[Skill] = SKILLS) -> tuple[SkillCall, ...]:
    """Read a planner's text as skill calls.

    Comments, blank lines, an even indent and a surrounding code fence are allowed; the first
    argument is `robot` or `robots`.

    Returns:
        The calls in order, with line numbers of `text` from 1; () for a text without calls.

    Raises:
        ProgramError: the text says anything else; nothing else is ever raised.

    >>> parse_program("PutObject(robot, 'Apple', 'Fridge')")[0].objects
    ('Apple', 'Fridge')
    """
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    _check_size(text, lines)
    body = textwrap.dedent("\n".join(_without_fence(lines)))
    table = {skill.name: skill for skill in skills}
    calls = []
    for statement in _syntax(body, lines):
        try:
            calls.append(_call(statement, table))
        except _RefusedError as refusal:
            raise _error(refusal.reason, refusal.line or statement.lineno, lines) from None
    return tuple(calls)


class _RefusedError(Exception):
    """Why a node is outside the API; becomes a ProgramError with the line quoted."""

    def __init__(self, reason: str, node: ast.AST) -> None:
        super().__init__(reason)
        self.reason, self.line = reason, int(getattr(node, "lineno", 0))


def _error(reason: str, line: int, lines: Sequence[str]) -> ProgramError:
    line = min(max(line, 1), len(lines))
    return ProgramError(reason, line=line, code=_short(lines[line - 1].strip()))


def _short(text: str, width: int = 120) -> str:
    return text if len(text) <= width else f"{text[: width - 3]}..."


def _check_size(text: str, lines: Sequence[str]) -> None:
    if "\0" in text:
        number = next(n for n, line in enumerate(lines, 1) if "\0" in line)
        raise _error("null bytes are not allowed", number, lines)
    if len(lines) > MAX_LINES:
        raise _error(f"a program has at most {MAX_LINES} lines", MAX_LINES + 1, lines)
    if len(text) > MAX_CHARACTERS:
        raise _error(f"a program has at most {MAX_CHARACTERS} characters", 1, lines)


def _without_fence(lines: Sequence[str]) -> list[str]:
    """Return the lines with a surrounding code fence blanked, so that line numbers stay."""
    kept = list(lines)
    filled = [n for n, line in enumerate(kept) if line.strip()]
    if filled and _FENCE.fullmatch(kept[filled[0]]):
        kept[filled[0]] = ""
        if filled[1:] and kept[filled[-1]].strip() == "```":
            kept[filled[-1]] = ""
    return kept


def _syntax(body: str, lines: Sequence[str]) -> list[ast.stmt]:
    try:
        with warnings.catch_warnings():  # odd escapes in a text are no concern of the user's
            warnings.simplefilter("ignore")
            return ast.parse(body).body
    except SyntaxError as error:
        raise _error(f"not a program: {error.msg}", error.lineno or 1, lines) from None
    except (RecursionError, MemoryError):
        raise _error("nested too deeply", 1, lines) from None
    except ValueError:  # e.g. lone surrogates, endless numbers
        raise _error("not a program: the text cannot be read", 1, lines) from None


def _call(statement: ast.stmt, table: dict[str, Skill]) -> SkillCall:
    match statement:
        case ast.Expr(ast.Call(ast.Name("refuse"), _, _)):
            raise _RefusedError(
                f"refuse stands alone, with one of {', '.join(REFUSAL_KINDS)}", statement
            )
        case ast.Expr(ast.Call(ast.Name(name), [ast.Name("robot" | "robots"), *rest], [])):
            objects, positions = _arguments(_signature(name, table, statement), rest, statement)
            return SkillCall(
                skill=name, objects=objects, positions=positions, line=statement.lineno
            )
        case ast.Expr(ast.Call(ast.Name(name), _, [_, *_])):
            raise _RefusedError(f"{name} takes no keyword arguments", statement)
        case ast.Expr(ast.Call(ast.Name(name), _, _)):
            _signature(name, table, statement)
            raise _RefusedError(f"the first argument of {name} must be robot", statement)
        case _:
            what = _STATEMENTS.get(type(statement), "this")
            only = "only skill calls such as GoToObject(robot, 'Apple') are allowed"
            raise _RefusedError(f"{only}, not {what}", statement)


def _signature(name: str, table: dict[str, Skill], node: ast.AST) -> Skill:
    if name in table:
        return table[name]
    folded = {known.lower(): known for known in table}
    near = get_close_matches(name[:MAX_NAME].lower(), folded, n=1)
    hint = f" Did you mean {folded[near[0]]}?" if near else f" Skills: {', '.join(table)}."
    raise _RefusedError(f"there is no skill {_short(name, 60)}.{hint}", node)


def _arguments(
    skill: Skill, nodes: Sequence[ast.expr], at: ast.AST
) -> tuple[tuple[str, ...], tuple[str | Vec3, ...]]:
    most = len(skill.arguments)
    least = most - skill.optional
    if not least <= len(nodes) <= most:
        count = str(most) if least == most else f"{least} to {most}"
        raise _RefusedError(
            f"{skill.name} takes robot and {count} more argument(s), not {len(nodes)}", at
        )
    objects: list[str] = []
    positions: tuple[str | Vec3, ...] = ()
    for kind, node in zip(skill.arguments, nodes, strict=False):
        if kind == "object":
            objects.append(_name(node))
        else:
            positions = _positions(node)
    return tuple(objects), positions


def _name(node: ast.expr) -> str:
    match node:
        case ast.Constant(str(value)):
            name = value.strip()
        case _:
            raise _RefusedError("an object is a quoted name such as 'Apple'", node)
    if len(name) > MAX_NAME:
        raise _RefusedError(f"a name has at most {MAX_NAME} characters", node)
    if not _NAME.fullmatch(name):
        raise _RefusedError("a name has letters, digits, spaces and |+-.,()/&_ only", node)
    return name


def _positions(node: ast.expr) -> tuple[str | Vec3, ...]:
    match node:
        case ast.List(items) if len(items) <= MAX_POSITIONS:
            return tuple(_position(item) for item in items)
        case _:
            raise _RefusedError(
                f"positions are a list of at most {MAX_POSITIONS} names or (x, y, z)", node
            )


def _position(node: ast.expr) -> str | Vec3:
    match node:
        case ast.Constant(str()):
            return _name(node)
        case ast.Tuple([x, y, z]):
            return _metres(x), _metres(y), _metres(z)
        case _:
            raise _RefusedError("a position is a quoted name or (x, y, z) in metres", node)


def _metres(node: ast.expr) -> float:
    match node:
        case ast.UnaryOp(ast.USub(), ast.Constant(int(value) | float(value))):
            number = -value
        case ast.Constant(int(value) | float(value)):
            number = value
        case _:
            raise _RefusedError("a coordinate is a number in metres", node)
    if isinstance(value, bool) or not abs(number) <= MAX_METRES:  # also where it is no number
        raise _RefusedError(f"a coordinate is a number within {MAX_METRES:.0f} metres", node)
    return float(number)
