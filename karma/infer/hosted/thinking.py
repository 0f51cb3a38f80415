"""Tell a model's thought from its answer, and let a grammar begin after the thought."""

from collections.abc import Mapping
from typing import Any

_FIELDS = ("reasoning_content", "reasoning", "thinking")  # that servers return a thought in
_SPOKEN = ("text", "output_text", "refusal", None)  # types of parts of a message
_THOUGHT = ("thinking", "reasoning")
_TAGS = (("<think>", "</think>"), ("<thinking>", "</thinking>"), ("[THINK]", "[/THINK]"))


def told_apart(message: Mapping[str, Any]) -> tuple[str, str]:
    r"""Return answer and thought of a message, wherever its server has put the thought.

    A thought that was begun and not ended leaves no answer.

    >>> told_apart({"content": "<think>An apple.</think>\n\nGo"})
    ('Go', 'An apple.')
    >>> told_apart({"content": None, "reasoning_content": "An app"})
    ('', 'An app')
    """
    thoughts = [message.get(name) for name in _FIELDS]
    thought: str = next((one for one in thoughts if isinstance(one, str) and one), "")
    content = message.get("content") or message.get("refusal") or ""
    if isinstance(content, list) and all(isinstance(one, dict) for one in content):
        parts = [(one.get("type"), _text_of(one)) for one in content]
        thought = "".join([thought, *(text for kind, text in parts if kind in _THOUGHT)])
        content = "".join(text for kind, text in parts if kind in _SPOKEN)
    if not isinstance(content, str):
        raise TypeError(f"a {type(content).__name__} where a text should be")
    for opening, closing in _TAGS:
        before, found, after = content.rpartition(closing)
        if found:  # the opening tag may have been in the prompt
            inside = before.strip().removeprefix(opening).strip()
            return after.lstrip(), "\n".join(filter(None, [thought, inside]))
        if content.lstrip().startswith(opening):
            inside = content.lstrip().removeprefix(opening).strip()
            return "", "\n".join(filter(None, [thought, inside]))
    return content, thought


def _text_of(part: Mapping[str, Any]) -> str:
    """Return the text of a part of a message, which may have parts itself."""
    said = part.get("text", part.get("thinking", ""))
    inner = said if isinstance(said, list) else [said]
    return "".join(one if isinstance(one, str) else str(one.get("text", "")) for one in inner)


def gbnf_after_thought(grammar: str, opens_thought: bool) -> str:
    r"""Return a grammar that admits a thought of any words before what the given one admits.

    Args:
        grammar: its root is the rule `root`.
        opens_thought: the prompt ends in `<think>`; else the model says that first.

    >>> print(gbnf_after_thought('root ::= "yes"', opens_thought=True))
    root ::= !</think>* </think> "\n\n" answer
    answer ::= "yes"
    """
    opening = "" if opens_thought else "<think> "
    answer = grammar.replace("root ::=", "answer ::=", 1)
    return f'root ::= {opening}!</think>* </think> "\\n\\n" answer\n{answer}'
