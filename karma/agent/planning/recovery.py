"""Find the program in an answer that no grammar held: talk before it, numbers and marks around it.

Only whole lines count, and all that hold a call do: one that cannot be read makes the answer no
program, as what it was to do would be left out. A program that begins anew replaces the draft
before it. What is code but no program, such as a loop, is not recovered, since it means more than
its calls.
"""

import ast
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

from karma.agent.planning.program import SKILLS, parse_program
from karma.errors import ProgramError
from karma.models.completeness import going_round, in_plain_signs, own_text, repeated
from karma.types.completion import Completion
from karma.types.planning import REFUSAL_KINDS, FailedProgram, RefusedRequest, Skill, SkillCall

_LABEL = r"(?:[Ss]tep|STEP|[Aa]ction|[Cc]all|[Ll]ine)"
_MARKS = (
    rf"(?:(?:{_LABEL}\s*)?\(?\d+\s*[.):\-–—|]|{_LABEL}\s*\w*\s*[:.)\-–—]|[A-Za-z]\)|- \[[ xX]\]"
    r"|<\w+>|await|[^\w\s(<#/])"
)  # of lists, of emphasis
_CALL = r"""[A-Za-z_]\w*\(\s*robots?\b(?:[^()'"]|'[^'\n]*'|"[^"\n]*"|\([^()\n]*\))*\)"""
_TAIL = r"(?:</\w+>|[^\w(</])*(?:\s*(?:#|//|/\*|<!--|-|=>|–|—|→|←|:|\||\().*)?"
_LINE = re.compile(rf"\s*(?:{_MARKS}\s*)*(?P<call>{_CALL}){_TAIL}\s*")
_ANY_CALL = re.compile(r"\w+\s*\(\s*robots?\b|\brobots?\s*\.\s*\w+\(")
_REFUSAL = re.compile(r"""\s*[`*]*refuse\(\s*(['"])(?P<kind>\w+)\1\s*\)[`*.]*\s*""")
_BLOCK = re.compile(r"\s*(?:async |for|while|if|elif|else|def|class|with|try|except|match)\b.*:\s*")
_ANEW = re.compile(
    r"\b(?:correct(?:ed|ion|ing)?|revised?|fixed|final|updated|improved|better)\b", re.I
)
_SAME = 2  # first calls of a draft with which a program begins anew


@dataclass(frozen=True, slots=True, kw_only=True)
class Recovered:
    """What was read of an answer: its program, or why there is none."""

    calls: tuple[SkillCall, ...] = ()  # with line numbers of the answer
    dropped: tuple[str, ...] = ()  # lines of the answer that were no part of it
    refused: RefusedRequest | None = None  # in place of calls
    error: str = ""  # why the answer is refused
    failure: FailedProgram | None = None  # the same with its lines


def program_of(
    completion: Completion, skills: Sequence[Skill] = SKILLS, *, refusing: bool = False
) -> Recovered:
    """Return the program of an answer; one that a grammar held is taken by its word.

    Raises:
        ProgramError: it is none, or the model says itself that it cannot be one.
    """
    text = in_plain_signs(own_text(completion.text))
    if completion.fault:
        lines = text.rstrip().split("\n")
        raise ProgramError(completion.fault, line=len(lines), code=lines[-1].strip()[:120])
    if refusing and (refusal := refusal_in(text)):
        return refusal
    try:
        found = Recovered(calls=parse_program(text, skills))
    except ProgramError:
        if completion.constrained:
            raise
        found = recover_program(text, skills)
    _check_circles(found.calls)
    return found


def _check_circles(calls: Sequence[SkillCall]) -> None:
    """Refuse a program that says the same for the third time running."""
    found = repeated([str(call) for call in calls])
    if found is not None:
        end, size = found
        last = calls[end - 1]
        raise ProgramError(going_round(size), line=last.line, code=str(last))


def recover_program(text: str, skills: Sequence[Skill] = SKILLS) -> Recovered:
    r"""Read the lines of an answer that are calls and leave out the others.

    Raises:
        ProgramError: there is none, one is outside the API, or the answer is other code.

    >>> found = recover_program("Sure!\n1. GoToObject(robot, 'Mug')\n2. PickupObject(robot, 'Mug')")
    >>> [str(call) for call in found.calls], found.dropped
    (["GoToObject(robot, 'Mug')", "PickupObject(robot, 'Mug')"], ('Sure!',))
    """
    lines = own_text(text).replace("\r\n", "\n").replace("\r", "\n").split("\n")
    found = [_LINE.fullmatch(line) for line in lines]
    kept = [match["call"] if match else "" for match in found]
    dropped = tuple(line.strip() for line, call in zip(lines, kept, strict=True) if not call)
    dropped = tuple(filter(None, dropped))
    if not any(kept) or (dropped and _is_code(text)) or any(map(_BLOCK.fullmatch, dropped)):
        parse_program(text, skills)  # says what is wrong
        raise ProgramError("the answer holds no skill call on a line of its own", line=1, code="")
    _check_unread(lines, kept, skills)
    kept = _without_draft(lines, kept)
    return Recovered(calls=parse_program("\n".join(kept), skills), dropped=dropped)


def _check_unread(lines: Sequence[str], kept: Sequence[str], skills: Sequence[Skill]) -> None:
    """Refuse an answer in which a line holds a call, or the last begins one, that was not read."""
    last = max(number for number, line in enumerate(lines) if line.strip())
    for number, line in enumerate(lines):
        if kept[number]:
            continue
        begun = number == last and _is_begun(line, skills)
        if begun or _ANY_CALL.search(line):
            reason = "a call on this line cannot be read: one whole call a line, and no words"
            raise ProgramError(reason, line=number + 1, code=line.strip()[:120])


def _is_begun(line: str, skills: Sequence[Skill]) -> bool:
    """Return whether a last line may be the beginning of a call, or of its number."""
    word = re.sub(rf"^\s*(?:{_MARKS}\s*)*", "", line).strip()
    if not word:
        return bool(re.fullmatch(r"\s*\(?\d+\s*[.):]?\s*", line))
    name = word.partition("(")[0].strip()
    return any(one.name.startswith(name) and (name == word or "(" in word) for one in skills)


def _without_draft(lines: Sequence[str], kept: Sequence[str]) -> list[str]:
    """Return the calls of the last program where an answer holds a draft and its correction.

    It begins anew with the first calls of the draft, or after words that say so.
    """
    program = list(kept)
    start, talk, begun = 0, "", False
    for number, call in enumerate(kept):
        if not call:
            talk += f" {lines[number]}" if lines[number].strip() else ""
            continue
        if begun and talk:
            draft = [one for one in program[start:number] if one]
            again = [one for one in kept[number:] if one][:_SAME]
            if _ANEW.search(talk) or (len(again) == _SAME and draft[:_SAME] == again):
                program[start:number] = [""] * (number - start)
                start = number
        talk, begun = "", True
    return program


def refusal_in(text: str) -> Recovered | None:
    r"""Return the refusal that stands alone, or alone on a line of an answer without any call.

    >>> str(refusal_in("I am sorry.\nrefuse('thing')").refused)
    "refuse('thing')"
    """
    lines = text.splitlines()
    found = [match["kind"] for line in lines if (match := _REFUSAL.fullmatch(line))]
    kind = next((kind for kind in REFUSAL_KINDS if [kind] == found), None)
    if kind is None or any(map(_LINE.fullmatch, lines)):
        return None
    rest = (line.strip() for line in lines if not _REFUSAL.fullmatch(line))
    dropped = tuple(line for line in rest if line.strip("`"))
    return Recovered(refused=RefusedRequest(kind=kind), dropped=dropped)


def _is_code(text: str) -> bool:
    with suppress(SyntaxError, ValueError, RecursionError, MemoryError):
        ast.parse(text)
        return True
    return False
