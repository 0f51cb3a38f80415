"""Find the program in an answer that no grammar held: talk before it, numbers and marks around it.

Only whole lines count: a call that stands inside a sentence is talk. What is code but no program,
such as a loop, is not recovered, since it means more than its calls.
"""

import ast
import re
from collections.abc import Sequence
from dataclasses import dataclass

from karma.agent.program import SKILLS, parse_program, parse_refusal
from karma.contracts import Completion, RefusedRequest, SkillCall, SkillSignature
from karma.errors import ProgramError
from karma.language.whole import going_round, repeated

_MARKS = r"(?:(?:[Ss]tep\s*)?\d+\s*[.):]|[-*•>+`]|\*\*)"  # of lists, of emphasis
_CALL = r"""[A-Za-z_]\w*\(\s*robots?\b(?:[^()'"]|'[^'\n]*'|"[^"\n]*"|\([^()\n]*\))*\)"""
_LINE = re.compile(rf"\s*(?:{_MARKS}\s*)*(?P<call>{_CALL})[`*;.,]*(?:\s*(?:#|//|-|–|—|:|\().*)?\s*")
_REFUSAL = re.compile(r"""\s*[`*]*(refuse\(\s*(?:'\w+'|"\w+")\s*\))[`*.]*\s*""")
_BLOCK = re.compile(r"\s*(?:async |for|while|if|elif|else|def|class|with|try|except|match)\b.*:\s*")


@dataclass(frozen=True, slots=True, kw_only=True)
class Recovered:
    """A program that stood in an answer, and the lines of the answer that were no part of it."""

    calls: tuple[SkillCall, ...] = ()  # with line numbers of the answer
    dropped: tuple[str, ...] = ()
    refused: RefusedRequest | None = None  # in place of calls


def program_of(
    completion: Completion, skills: Sequence[SkillSignature] = SKILLS, *, refusing: bool = False
) -> Recovered:
    """Return the program of an answer; one that a grammar held is taken by its word.

    Args:
        completion: the answer.
        skills: that it may call.
        refusing: whether it may refuse the request instead.

    Raises:
        ProgramError: it is none, or the model says itself that it cannot be one.
    """
    text = completion.text
    if completion.fault:
        lines = text.rstrip().split("\n")
        raise ProgramError(completion.fault, line=len(lines), code=lines[-1].strip()[:120])
    if refusing and (refusal := _refusal(text)):
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


def recover_program(text: str, skills: Sequence[SkillSignature] = SKILLS) -> Recovered:
    r"""Read the lines of an answer that are calls and leave out the others.

    Raises:
        ProgramError: there is none, one is outside the API, or the answer is other code.

    >>> found = recover_program("Sure!\n1. GoToObject(robot, 'Mug')\n2. PickupObject(robot, 'Mug')")
    >>> [str(call) for call in found.calls], found.dropped
    (["GoToObject(robot, 'Mug')", "PickupObject(robot, 'Mug')"], ('Sure!',))
    """
    kept: list[str] = []
    dropped: list[str] = []
    for line in text.replace("\r\n", "\n").replace("\r", "\n").split("\n"):
        found = _LINE.fullmatch(line)
        kept.append(found["call"] if found else "")
        if not found and line.strip():
            dropped.append(line.strip())
    if not any(kept) or (dropped and _is_code(text)) or any(map(_BLOCK.fullmatch, dropped)):
        parse_program(text, skills)  # says what is wrong
        raise ProgramError("the answer holds no skill call on a line of its own", line=1, code="")
    return Recovered(calls=parse_program("\n".join(kept), skills), dropped=tuple(dropped))


def _refusal(text: str) -> Recovered | None:
    """Return the refusal that stands alone, or alone on a line of an answer without any call."""
    lines = text.splitlines()
    said = [match[1] for line in lines if (match := _REFUSAL.fullmatch(line))]
    if len(said) != 1 or any(map(_LINE.fullmatch, lines)):
        return None
    refused = parse_refusal(said[0])
    if refused is None:
        return None
    rest = (line.strip() for line in lines if not _REFUSAL.fullmatch(line))
    return Recovered(refused=refused, dropped=tuple(one for one in rest if one.strip("`")))


def _is_code(text: str) -> bool:
    try:
        ast.parse(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return False
    return True
