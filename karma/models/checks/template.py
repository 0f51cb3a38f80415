"""Try a chat template before it is compiled here: it is a program out of somebody's file.

Jinja's sandbox keeps it from the machine's files, but not from its time and memory: `9**9**9` is
worked out while a model is opened. What grows without bound when it is compiled is refused by form;
what is left is tried in a process of its own, with little time and memory.
"""

import re
import sys
from functools import lru_cache
from typing import Any

from karma.errors import ModelError
from karma.offline.children import run_child

TEMPLATE = "tokenizer.chat_template"  # key of a GGUF's metadata
LONGEST = 256 << 10  # characters; the longest in use have 20,000
LARGEST_NUMBER = 1_000_000
_WIDE = re.compile(r"[%:]\D{0,3}\d{7,}")  # in a format
_SECONDS, _MEGABYTES = 20, 1024


@lru_cache  # of what has passed: an error is not kept
def try_template(name: str, text: str) -> str:
    """Render a template in a process of its own; return why it cannot be used, "" if it can.

    ModelError where it takes much time or memory, and so must not be compiled at all.
    """
    if len(text) > LONGEST:
        raise ModelError(f"{name}: its chat template has {len(text)} characters; too many")
    if reason := _boundless(text):
        raise ModelError(f"{name}: its chat template {reason}; not opened")
    end = run_child(f"{__name__}:trial", given=text, limit_s=10 * _SECONDS)
    if end.code is None or end.code < 0 or end.code == _TOO_MUCH:
        raise ModelError(
            f"{name}: its chat template comes to no end ({_SECONDS} s of computing,"
            f" {_MEGABYTES} MB); not opened"
        )
    return f"its chat template cannot be used: {end.said[:200]}" if end.code else ""


def _boundless(text: str) -> str:
    """Return what in a template could grow without bound when it is compiled."""
    import jinja2
    from jinja2 import nodes
    from llama_cpp.llama_chat_format import Jinja2ChatFormatter

    tags = [Jinja2ChatFormatter.IgnoreGenerationTags, "jinja2.ext.loopcontrols"]  # the runtime's
    try:
        tree = jinja2.Environment(extensions=tags).parse(text)
    except jinja2.TemplateSyntaxError:
        return ""  # the runtime cannot compile it either; whoever uses it hears of it
    except RecursionError:
        return "is nested too deeply"
    values = [const.value for const in tree.find_all(nodes.Const)]
    if any(True for _ in tree.find_all(nodes.Pow)):
        return "raises numbers to powers"
    if any(isinstance(value, int) and abs(value) > LARGEST_NUMBER for value in values):
        return f"holds a number beyond {LARGEST_NUMBER}"
    if any(isinstance(value, str) and _WIDE.search(value) for value in values):
        return "pads a text to any width"
    if any(True for product in tree.find_all(nodes.Mul) for _ in product.find_all(nodes.Mul)):
        return "multiplies again and again"
    return ""


_TOO_MUCH = 3  # exit code


def trial() -> None:
    """Render the template that standard input holds, in a process that can take little."""
    import resource

    resource.setrlimit(resource.RLIMIT_CPU, (_SECONDS, _SECONDS))
    resource.setrlimit(resource.RLIMIT_DATA, (_MEGABYTES << 20, _MEGABYTES << 20))
    from llama_cpp.llama_chat_format import Jinja2ChatFormatter

    try:
        form = Jinja2ChatFormatter(template=sys.stdin.read(), bos_token="", eos_token="")
    except MemoryError:
        sys.exit(_TOO_MUCH)
    contents: tuple[Any, ...] = ("Say yes.", [{"type": "text", "text": "Say yes."}])
    for content in contents:
        for roles in (("user",), ("system", "user")):
            messages: Any = [{"role": role, "content": content} for role in roles]
            try:
                form(messages=messages)
            except MemoryError:
                sys.exit(_TOO_MUCH)
            except Exception:  # noqa: BLE001 - it may refuse a form of conversation
                pass
