"""Write the language of a spec as one regular expression that matches whole programs."""

from karma.contracts import ProgramSpec
from karma.infer.programs.automaton import CLOSINGS, Argument, LineForm, forms, refusal_lines

_SIGNS = frozenset(".^$*+?{}[]()|\\")


def regex(spec: ProgramSpec) -> str:
    r"""Return the expression, in what all dialects of regular expressions share.

    Raises:
        ValueError: the spec admits no program.

    >>> from karma.contracts import Skill
    >>> go = Skill(name="GoToObject", arguments=("object",))
    >>> print(regex(ProgramSpec(skills=(go,), objects=("Mug", "Sink"), max_calls=1)))
    ((GoToObject)\(robot, '(Mug|Sink)'\))(\n(\n|```|#)?)?
    """
    line = f"({'|'.join(map(_line, forms(spec)))})"
    more = rf"(\n{line}){{0,{spec.max_calls - 1}}}" if spec.max_calls > 1 else ""
    closing = _any(CLOSINGS).replace("\n", r"\n")
    program = rf"{line}{more}(\n{closing}?)?"
    refusals = [rf"{escaped(line)}\n?" for line in refusal_lines(spec)]
    return f"({'|'.join([program, *refusals])})" if refusals else program


def _line(form: LineForm) -> str:
    rest = ""
    for argument in reversed(form.arguments[form.needed :]):
        rest = f"({_argument(argument)}{rest})?"
    needed = "".join(map(_argument, form.arguments[: form.needed]))
    return rf"{_any(form.skills)}\(robot{needed}{rest}\)"


def _argument(argument: Argument) -> str:
    name = f"'{_any(argument.names)}'"
    if not argument.most:
        return f", {name}"
    return rf", \[{name}(, {name}){{0,{argument.most - 1}}}\]"


def _any(words: tuple[str, ...]) -> str:
    return f"({'|'.join(map(escaped, words))})"


def escaped(text: str) -> str:
    r"""Return an expression that matches the text alone.

    >>> print(escaped("Apple|1.5"))
    Apple\|1\.5
    """
    return "".join(f"\\{sign}" if sign in _SIGNS else sign for sign in text)
