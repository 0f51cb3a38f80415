"""GBNF grammars, loaded only after they were tried in a process that may die.

llama.cpp does not refuse a bad grammar: a syntax error, an undefined rule or left recursion end
the process. Constrained programs do not need this; `constrain` is exact and faster.
"""

import subprocess
import sys
from pathlib import Path
from typing import Any

from karma.errors import ModelError

_TIMEOUT_S = 60

# Only the grammar's own parser and its first step run here; no model and no vocabulary.
_TRIAL = """
import ctypes, sys
import llama_cpp
from llama_cpp import llama_cpp as c
grammar = sys.stdin.buffer.read()
sampler = c.llama_sampler_init_grammar(None, grammar, b"root")
sys.exit(0 if sampler else 3)
"""


def load_gbnf(source: str | Path) -> Any:
    """Return a `llama_cpp.LlamaGrammar` from a .gbnf file (a `Path`) or from GBNF text.

    Raises:
        ModelError: the file cannot be read, or llama.cpp would not survive the grammar.
    """
    where = str(source) if isinstance(source, Path) else "GBNF text"
    try:
        text = source.read_text(encoding="utf-8") if isinstance(source, Path) else source
    except (OSError, UnicodeDecodeError) as error:
        raise ModelError(f"{where}: {error}") from error
    if not text.strip():
        raise ModelError(f"{where}: empty, it would admit every text")
    _try(text, where)
    from llama_cpp import LlamaGrammar

    return LlamaGrammar.from_string(text, verbose=False)


def _try(text: str, where: str) -> None:
    """Parse the grammar in a process of its own."""
    command = [sys.executable, "-c", _TRIAL]
    try:
        result = subprocess.run(
            command, input=text.encode(), capture_output=True, timeout=_TIMEOUT_S, check=False
        )
    except subprocess.TimeoutExpired as error:
        raise ModelError(f"{where}: not parsed within {_TIMEOUT_S} s") from error
    if result.returncode != 0:
        said = result.stderr.decode(errors="replace").strip().splitlines()[:3]
        reason = "; ".join(said) or f"llama.cpp ended with code {result.returncode}"
        raise ModelError(f"{where}: not a grammar that llama.cpp accepts: {reason}")
