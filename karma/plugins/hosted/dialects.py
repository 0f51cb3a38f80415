"""Find out who answers at an endpoint, and say to each kind of server what it understands.

Every server ignores some form of constraint without a word, so none is trusted: see `planner`.
docs/plugins/hosted.md says which dialects were tried against the real server.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from types import MappingProxyType
from typing import Any

from karma.errors import ModelError
from karma.models import constraint
from karma.models.endpoint import Constraint, DialectName, Endpoint
from karma.plugins.hosted.connection import Connection
from karma.plugins.hosted.grammars import gbnf, program_text, schema
from karma.types.completion import Thinking
from karma.types.planning import AnswerSpec, JsonSpec, ProgramSpec

Fields = dict[str, Any]  # of a request


@dataclass(frozen=True, slots=True, kw_only=True)
class Language:
    """What an answer may say, in every form that a server may take."""

    grammar: str  # GBNF
    schema: Mapping[str, Any] | None  # None: the answers cannot be written in JSON
    read: Callable[[str], str | None] = field(compare=False)  # a JSON answer as the text it means
    admits: Callable[[str], bool] = field(compare=False)
    begins: Callable[[str], bool] = field(compare=False)  # something that is admitted
    otherwise: Constraint | None = None  # the form for a dialect that is bound by none unless told


@lru_cache(maxsize=8)
def language_of(spec: AnswerSpec) -> Language:
    """Return the answers of a spec; ValueError where it admits none."""
    grammar = spec.grammar
    language = Language(
        grammar=gbnf(grammar),
        schema=schema(spec) if isinstance(spec, ProgramSpec) else None,
        read=program_text,
        admits=lambda text: constraint.admits(grammar, text),
        begins=lambda text: constraint.begins(grammar, text),
    )
    if not isinstance(spec, JsonSpec):
        return language
    return replace(
        language, schema=spec.schema, read=lambda text: text, admits=spec.admits,
        otherwise="schema",
    )  # fmt: skip


Binding = Callable[[Language], Fields]


def _response_format(language: Language) -> Fields:
    named = {"name": "program", "strict": True, "schema": dict(language.schema or {})}
    return {"response_format": {"type": "json_schema", "json_schema": named}}


def _structured(name: str, of: Callable[[Language], Any]) -> Binding:
    return lambda language: {"structured_outputs": {name: of(language)}}


@dataclass(frozen=True, slots=True, kw_only=True)
class Dialect:
    """How one kind of server is spoken to."""

    name: DialectName
    page: tuple[str, str] | None = None  # that only it has, and what stands on it
    bindings: Mapping[Constraint, Binding] = field(default_factory=dict)
    constraint: Constraint | None = None  # the one that is used unless told otherwise
    thinking: Callable[[bool], Fields] = lambda on: {}  # fields of a chat that switch it
    budget: str = ""  # the field that bounds a thought
    thought_in_grammar: bool = False  # a grammar binds from the first token, the thought's too


def _by_template(on: bool) -> Fields:
    return {"chat_template_kwargs": {"enable_thinking": on}}


_ALL = (
    Dialect(
        name="llama-server",
        page=("../props", "default_generation_settings"),
        bindings={
            "grammar": lambda language: {"grammar": language.grammar},
            "schema": lambda language: {"json_schema": dict(language.schema or {})},
        },
        constraint="grammar",
        thinking=_by_template,
        budget="reasoning_budget_tokens",
        thought_in_grammar=True,
    ),
    Dialect(
        name="vllm",
        page=("../version", "version"),
        bindings={
            "grammar": _structured("grammar", lambda language: language.grammar),
            "schema": _structured("json", lambda language: dict(language.schema or {})),
        },
        constraint="grammar",
        thinking=_by_template,
        budget="thinking_token_budget",
    ),
    Dialect(
        name="sglang",
        page=("../server_info", "model_path"),
        bindings={
            "grammar": lambda language: {"ebnf": language.grammar},
            "schema": _response_format,
        },
        constraint="grammar",
        thinking=_by_template,
    ),
    Dialect(
        name="ollama",
        page=("../api/version", "version"),
        bindings={"schema": _response_format},
        constraint="schema",
        thinking=lambda on: {} if on else {"reasoning_effort": "none"},
    ),
    Dialect(name="plain", bindings={"schema": _response_format}),
)
DIALECTS: Mapping[str, Dialect] = MappingProxyType({one.name: one for one in _ALL})


def gbnf_after_thought(grammar: str, opens_thought: bool) -> str:
    r"""Return a grammar that admits a thought of any words before what the given one admits.

    `opens_thought`: the prompt ends in `<think>`; else the model says that first.

    >>> print(gbnf_after_thought('root ::= "yes"', opens_thought=True))
    root ::= !</think>* </think> "\n\n" answer
    answer ::= "yes"
    """
    opening = "" if opens_thought else "<think> "
    answer = grammar.replace("root ::=", "answer ::=", 1)
    return f'root ::= {opening}!</think>* </think> "\\n\\n" answer\n{answer}'


@dataclass(frozen=True, slots=True, kw_only=True)
class Manner:
    """How one model at one server is asked: its dialect, and what was found out about it."""

    dialect: Dialect
    constraint: Constraint | None
    thinks: bool
    thinking_tokens: int
    chat: bool
    opens_thought: bool = False  # its template does, not the model

    def binding(self, language: Language | None) -> Constraint | None:
        """Return the form in which a request says the language; None: in none."""
        if language is None:
            return None
        form = self.constraint or language.otherwise
        if form not in self.dialect.bindings or (form == "schema" and language.schema is None):
            return None
        return form

    def fields(self, language: Language | None, max_tokens: int) -> tuple[Fields, int]:
        """Return what a request says beside its text, and the tokens that the answer may have."""
        found: Fields = {}
        bound = self.binding(language)
        if language is not None and bound is not None:
            if self.thinks and self.dialect.thought_in_grammar and bound == "grammar":
                found |= {"grammar": gbnf_after_thought(language.grammar, self.opens_thought)}
            else:
                found |= self.dialect.bindings[bound](language)
        if self.chat:
            found |= self.dialect.thinking(self.thinks)
        if not self.thinks:
            return found, max_tokens
        if self.dialect.budget:
            found[self.dialect.budget] = self.thinking_tokens
        return found, max_tokens + self.thinking_tokens


def manner_of(
    endpoint: Endpoint,
    connection: Connection | None = None,
    *,
    thinking: Thinking = "off",
    thinking_tokens: int = 1024,
) -> Manner:
    """Return how an endpoint's model is asked; without a connection, by the endpoint alone.

    A model whose `thinking` is on thinks before it answers, `thinking_tokens` at most.

    Raises:
        ModelError: the server cannot be reached, or takes no such constraint.
    """
    found = None if connection is None else _dialect_of(endpoint, connection)
    dialect = found or DIALECTS.get(endpoint.dialect, DIALECTS["plain"])
    constraint = endpoint.constraint or dialect.constraint
    if constraint is not None and constraint not in dialect.bindings:
        raise ModelError(
            f"{endpoint.model} at {endpoint.host}: a server of dialect {dialect.name!r} takes no"
            f" {constraint}\n  To fix: constraint is one of {', '.join(dialect.bindings) or 'none'}"
        )
    thinks, chat = thinking == "on", endpoint.api == "chat"
    opens = False
    if connection is not None and found and thinks and chat and dialect.thought_in_grammar:
        opens = _opens_thought(dialect, endpoint, connection)
    return Manner(
        dialect=dialect, constraint=constraint, thinks=thinks, thinking_tokens=thinking_tokens,
        chat=chat, opens_thought=opens,
    )  # fmt: skip


def _dialect_of(endpoint: Endpoint, connection: Connection) -> Dialect | None:
    """Return the dialect whose page the server has, of all or of the one that is named."""
    for one in DIALECTS.values():
        if one.page is not None and endpoint.dialect in ("auto", one.name):
            page, mark = one.page
            if mark in (connection.look(endpoint, page) or {}):
                return one
    return None


def _opens_thought(dialect: Dialect, endpoint: Endpoint, connection: Connection) -> bool:
    """Return whether the model's chat template ends a prompt in `<think>`."""
    body = {"messages": [{"role": "user", "content": "Say yes."}], **dialect.thinking(True)}
    answer = connection.ask("planner", endpoint, "../apply-template", body).reply.answer or {}
    return str(answer.get("prompt", "")).rstrip().endswith("<think>")
