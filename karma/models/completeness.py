"""Which answers are not whole, and in what words a planner is told so when it is asked again."""

import re
from collections.abc import Mapping, Sequence
from typing import Literal

# What servers say of how an answer ended (`finish_reason`); any other is a fault of the server.
ENDS = frozenset({None, "stop", "eos", "eos_token", "end_turn", "stop_sequence"})
CUTS: Mapping[str, Literal["length", "filter"]] = {
    "length": "length",
    "max_tokens": "length",
    "content_filter": "filter",
}

# How templates end a turn, and begin one: servers leak these signs into the text.
_END = re.compile(
    r"</s>|<(?:end_of_turn|eos|end)>|<\|(?!end_header)[^<>|\n]*(?:end|eot|eom|eos|return|stop)"
    r"[^<>|\n]*\|>|<｜[^<>｜\n]*end[^<>｜\n]*｜>|\[(?:EOS|/INST)\]",
    re.IGNORECASE,
)
_HEAD = re.compile(
    r"\s*(?:<s>|<bos>|<start_of_turn>(?:model)?|<\|(?:im_start|start_header_id|start|assistant)\|>"
    r"(?:assistant)?(?:<\|(?:end_header_id|message)\|>)?)\s*"
)

_ALIKE = {
    "(": "（", ")": "）", ",": "，", ":": "：", ";": "；", ".": "．", "=": "＝", "'": "‘’‚‛＇",
    '"': "“”„‟＂", "[": "［", "]": "］", " ": "\u00a0\u2007\u202f\u3000",
}  # signs that look like ASCII's and mean the same  # fmt: skip
_PLAIN = str.maketrans({sign: plain for plain, signs in _ALIKE.items() for sign in signs})
_QUOTED = re.compile(r"""('[^'\n]*'|"[^"\n]*")""")

TIMES = 3
LONGEST = 4  # lines of a cycle


def own_text(text: str) -> str:
    r"""Return what a model said in its turn: nothing after a sign that ends it, no sign before.

    >>> own_text("GoToObject(robot, 'Mug')<|im_end|>\n<|im_start|>user")
    "GoToObject(robot, 'Mug')"
    """
    if head := _HEAD.match(text):
        text = text[head.end() :]
    end = _END.search(text)
    return text[: end.start()] if end else text


def in_plain_signs(text: str) -> str:
    """Return a text with signs of word processors and of Chinese as ASCII's, save in quotes.

    >>> in_plain_signs("GoToObject（robot， ‘Mug’）")
    "GoToObject(robot, 'Mug')"
    """
    parts = _QUOTED.split(text)
    return "".join(part if n % 2 else part.translate(_PLAIN) for n, part in enumerate(parts))


def cycle(lines: Sequence[str] | Sequence[bytes]) -> int:
    """Return how many lines the last ones repeat for the third time; 0 where they do not.

    >>> cycle(["a", "b", "a", "b", "a", "b"]), cycle(["a", "a", "a"]), cycle(["a", "a", "b", "a"])
    (2, 1, 0)
    """
    for size in range(1, LONGEST + 1):
        last = lines[-size * TIMES :]
        if len(last) == size * TIMES and all(one == last[n % size] for n, one in enumerate(last)):
            return size
    return 0


def repeated(lines: Sequence[str]) -> tuple[int, int] | None:
    """Return the line, from 1, that ends the first third round, and its length; None: none does."""
    found = ((end, cycle(lines[:end])) for end in range(TIMES, len(lines) + 1))
    return next((one for one in found if one[1]), None)


def cut_off(tokens: int | None = None, *, seconds: float | None = None) -> str:
    """Return what is said of an answer that a limit has cut; tokens None: nobody counted them.

    >>> cut_off(512)
    'the answer was cut off after 512 tokens: it must be shorter'
    """
    if seconds is not None:
        return f"the answer was cut off after {seconds:g} s"
    many = "" if tokens is None else f" after {tokens} tokens"
    return f"the answer was cut off{many}: it must be shorter"


def filtered() -> str:
    """Return what is said of an answer that the server's filter has withheld, in whole or part."""
    return "the answer was withheld by the server's filter (content_filter): it is no program"


def going_round(size: int) -> str:
    """Return what is said of an answer in which so many lines came for the third time."""
    what = "one line" if size == 1 else f"{size} lines"
    return f"the answer repeats {what} for the third time: it must do each step once, and end"
