"""Check a chat template before it is compiled: it is a program out of somebody's file.

Jinja's sandbox keeps it from the machine's things, but not from its time and memory: `9**9**9` is
worked out while a model is opened. What could grow without bound is refused by form; what is left
is tried in a process of its own, with little time and memory.
"""

import re
import sys
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any

from karma.errors import ModelError
from karma.offline.children import run_child

TEMPLATE = "tokenizer.chat_template"  # key of a GGUF's metadata
LONGEST = 256 << 10  # characters; the longest in use have 20,000
LARGEST_NUMBER = 1_000_000
_WIDE = re.compile(r"[%:]\D{0,3}\d{7,}")  # in a format
_SECONDS, _MEGABYTES = 20, 1024


def check_template(path: Path | str, text: str) -> None:
    """Refuse a template that could take any time or memory; works nothing out.

    ModelError: it is none, or too long, raises numbers to powers, or repeats what repeats.
    """
    import jinja2
    from llama_cpp.llama_chat_format import Jinja2ChatFormatter

    if len(text) > LONGEST:
        raise ModelError(f"{path}: its chat template has {len(text)} characters; too many")
    tags = [Jinja2ChatFormatter.IgnoreGenerationTags, "jinja2.ext.loopcontrols"]  # the runtime's
    try:
        tree = jinja2.Environment(extensions=tags).parse(text)
    except jinja2.TemplateSyntaxError:
        return  # the runtime cannot compile it either; whoever uses it hears of it
    except RecursionError as error:
        raise ModelError(f"{path}: its chat template is nested too deeply") from error
    if reason := _boundless(tree):
        raise ModelError(f"{path}: its chat template {reason}; not opened")


def _boundless(tree: Any) -> str:
    """Return what in a template could grow without bound."""
    from jinja2 import nodes

    if any(True for _ in tree.find_all(nodes.Pow)):
        return "raises numbers to powers"
    values = [one.value for one in tree.find_all(nodes.Const)]
    if any(isinstance(one, int) and abs(one) > LARGEST_NUMBER for one in values):
        return f"holds a number beyond {LARGEST_NUMBER}"
    if any(isinstance(one, str) and _WIDE.search(one) for one in values):
        return "pads a text to any width"
    if any(True for one in tree.find_all(nodes.Mul) for _ in one.find_all(nodes.Mul)):
        return "multiplies again and again"
    loops = [loop for loop in tree.find_all(nodes.For) if _counts(loop.iter)]
    if any(_counts(inner.iter) for loop in loops for inner in _inside(loop)):
        return "counts inside of counting"
    return ""


def _counts(iterated: Any) -> bool:
    """Return whether what is looped over is `range(...)`."""
    from jinja2 import nodes

    called = (iterated, *iterated.find_all(nodes.Call))
    return any(
        isinstance(one, nodes.Call) and getattr(one.node, "name", "") == "range" for one in called
    )


def _inside(loop: Any) -> Iterator[Any]:
    from jinja2 import nodes

    for part in loop.body:
        yield from (part,) if isinstance(part, nodes.For) else ()
        yield from part.find_all(nodes.For)


@lru_cache  # of what has passed: an error is not kept
def try_template(name: str, text: str) -> None:
    """Render a template in a process of its own; ModelError where it takes much time or memory."""
    end = run_child(f"{__name__}:trial", given=text, limit_s=10 * _SECONDS)
    if end.code is None or end.code < 0:
        raise ModelError(f"{name}: its chat template comes to no end ({_SECONDS} s of computing)")
    if end.code:
        raise ModelError(f"{name}: its chat template cannot be used: {end.said[:200]}")


def trial() -> None:
    """Render the template that standard input holds, in a process that can take little."""
    import resource

    resource.setrlimit(resource.RLIMIT_CPU, (_SECONDS, _SECONDS))
    resource.setrlimit(resource.RLIMIT_DATA, (_MEGABYTES << 20, _MEGABYTES << 20))
    from llama_cpp.llama_chat_format import Jinja2ChatFormatter

    form = Jinja2ChatFormatter(template=sys.stdin.read(), bos_token="", eos_token="")
    contents: tuple[Any, ...] = ("Say yes.", [{"type": "text", "text": "Say yes."}])
    for content in contents:
        for roles in (("user",), ("system", "user")):
            messages: Any = [{"role": role, "content": content} for role in roles]
            try:
                form(messages=messages)
            except MemoryError:
                sys.exit(f"it takes more than {_MEGABYTES} MB")
            except Exception:  # noqa: BLE001 - it may refuse a form of conversation
                pass
