"""Write the language of a spec as GBNF, the grammars of llama.cpp; XGrammar reads them too."""

from karma.contracts import ProgramSpec
from karma.infer.programs.automaton import CLOSINGS, Argument, LineForm, forms, refusal_lines

_COMMA, _OPENS = ", '", ", ['"


def gbnf(spec: ProgramSpec) -> str:
    r"""Return the grammar, one rule a line; its root is the rule `root`.

    Raises:
        ValueError: the spec admits no program.

    >>> from karma.contracts import Skill
    >>> go = Skill(name="GoToObject", arguments=("object",))
    >>> print(gbnf(ProgramSpec(skills=(go,), objects=("Mug", "Sink"), max_calls=3)))
    root ::= line ("\n" line){0,2} ("\n" ("\n" | "```" | "#")?)?
    line ::= "GoToObject" "(robot" ", '" names0 ")"
    names0 ::= ("Mug" | "Sink") "'"
    """
    kinds = forms(spec)
    lists = list(dict.fromkeys(one.names for form in kinds for one in form.arguments))
    rule_of = {names: f"names{number}" for number, names in enumerate(lists)}
    newline = literal("\n")
    more = f" ({newline} line){{0,{spec.max_calls - 1}}}" if spec.max_calls > 1 else ""
    refusals = [f"{literal(line)} {newline}?" for line in refusal_lines(spec)]
    program = f"root ::= line{more} ({newline} {_any(CLOSINGS)}?)?"
    rules = [
        " | ".join([program, *refusals]),
        f"line ::= {' | '.join(_line(form, rule_of) for form in kinds)}",
        *(f'{rule} ::= {_any(names)} "\'"' for names, rule in rule_of.items()),
    ]
    return "\n".join(rules)


def literal(text: str) -> str:
    r"""Return a text as a terminal.

    >>> print(literal('a "b"'))
    "a \"b\""
    """
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    return f'"{escaped}"'


def _line(form: LineForm, rule_of: dict[tuple[str, ...], str]) -> str:
    parts = [_any(form.skills), literal("(robot")]
    parts += [_argument(one, rule_of[one.names]) for one in form.arguments[: form.needed]]
    rest = ""
    for one in reversed(form.arguments[form.needed :]):
        rest = f"({' '.join([_argument(one, rule_of[one.names]), rest]).rstrip()})?"
    return " ".join([*parts, *([rest] if rest else []), literal(")")])


def _argument(argument: Argument, rule: str) -> str:
    name = f"{literal(_COMMA)} {rule}"
    if not argument.most:
        return name
    more = f"({name}){{0,{argument.most - 1}}} " if argument.most > 1 else ""
    return f"{literal(_OPENS)} {rule} {more}{literal(']')}"


def _any(words: tuple[str, ...]) -> str:
    terminals = " | ".join(map(literal, words))
    return terminals if len(words) == 1 else f"({terminals})"
