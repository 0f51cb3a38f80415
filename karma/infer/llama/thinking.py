"""Let a thinking model think before it answers, and bound that.

The tags are `<think>` and `</think>`, as Qwen 3, QwQ and the models distilled from DeepSeek R1 have
them. A grammar holds from behind the closing tag on, never inside the thought.
"""

from collections.abc import Callable
from typing import NamedTuple

from karma.contracts import Thinking
from karma.infer.llama.answer import UnderWay
from karma.infer.llama.gguf_model import GgufModel

OPEN, CLOSE = "<think>", "</think>"
_GAP = "\n\n"  # between thought and answer, as the families' own templates have it


class Thought(NamedTuple):
    """What was thought."""

    text: str
    tokens: int  # that the model chose


def prepared(ending: str, thinking: Thinking) -> str:
    r"""Return what a template ends a prompt with, so that a thought is open or closed as wanted.

    >>> prepared("assistant:<think>\n", "off")
    'assistant:<think>\n\n</think>\n\n'
    >>> prepared("assistant:", "on")
    'assistant:<think>\n'
    """
    is_open = ending.rfind(OPEN) > ending.rfind(CLOSE)
    if thinking == "on":
        return ending if is_open else f"{ending}{OPEN}\n"
    return f"{ending.rstrip()}\n\n{CLOSE}{_GAP}" if is_open else ending


def think(model: GgufModel, budget: int, choose: Callable[[], int], answer: UnderWay) -> Thought:
    """Continue the thought that the evaluated prompt has opened, and close it.

    It ends where the model closes it, or would end its answer, or after `budget` tokens, or when
    time is up; what is then missing of the closing tag and the gap behind it is put there.
    ModelError as by `GgufModel.extend`.
    """
    tag = model.tokens(CLOSE, special=True)
    said, count, closed = b"", 0, False
    while count < budget and not closed and not answer.is_late:
        token = choose()
        if token in model.table.end_tokens:
            break
        count += 1
        said += CLOSE.encode() if [token] == tag else model.table.pieces[token]
        answer.came(model.table.pieces[token])
        model.extend([token])
        closed = CLOSE.encode() in said
    before, _, behind = said.decode("utf-8", errors="replace").partition(CLOSE)
    missing = _GAP.removeprefix(behind) if closed else f"\n{CLOSE}{_GAP}"
    if missing:
        model.extend(model.tokens(missing, special=True))
    return Thought(before.strip(), count)


def told_apart(text: str) -> tuple[str, str]:
    r"""Return the thought that a free answer begins with, "" if with none, and the rest of it.

    >>> told_apart("<think>\nAn apple.\n</think>\n\nGo")
    ('An apple.', 'Go')
    """
    before, tag, behind = text.partition(CLOSE)
    thought = before.strip()
    if not tag or not thought.startswith(OPEN):
        return "", text
    return thought.removeprefix(OPEN).strip(), behind.lstrip("\n")


def closing_tokens(model: GgufModel) -> int:
    """Return how many tokens it takes at most to close a thought."""
    return len(model.tokens(f"\n{CLOSE}{_GAP}", special=True))
