"""Open a hosted planner: ask who answers, and prove that it is held to programs.

Servers that do not know a field pass over it and answer freely. So the model is asked to write
prose while the constraint admits nothing but one of two words that no prompt has ever held. A
model that is not held to them says something else.
"""

import re

from karma.errors import ModelError
from karma.models.endpoint import Endpoint
from karma.models.session import Session
from karma.plugins.hosted.connection import Connection
from karma.plugins.hosted.dialects import Language, manner_of
from karma.plugins.hosted.grammars import object_schema
from karma.plugins.hosted.model import HostedLanguageModel
from karma.seeds import stream
from karma.types.completion import Thinking
from karma.types.grammars import any_of
from karma.types.planning import Prompt
from karma.types.roles import LanguageModel

_TIMES = 2
_MAX_TOKENS = 256  # of letters one by one, and of the white space that JSON may have
_PROMPT = Prompt(
    stable="You are a friendly guide.\n", changing="Describe the weather of today in a sentence.\n"
)
_REFUSED = re.compile(r"HTTP (400|422|500)")  # a field that the server will not have


def open_planner(
    endpoint: Endpoint,
    *,
    session: Session | None = None,
    constrained: bool = False,
    thinking: Thinking = "off",
    thinking_tokens: int = 1024,
    seed: int = 0,
) -> LanguageModel:
    """Return the model at an endpoint, as `manner_of` says; if `constrained`, `prove` tries it.

    Raises:
        ModelError: see `manner_of` and `prove`.
        KarmaError: see `Connection.admit`.
    """
    session = session or Session()
    connection = Connection(session)
    connection.admit(endpoint)
    manner = manner_of(endpoint, connection, thinking=thinking, thinking_tokens=thinking_tokens)
    model = HostedLanguageModel(endpoint, session=session, manner=manner)
    if constrained:
        prove(model, seed)
    return model


def prove(model: HostedLanguageModel, seed: int = 0) -> None:
    """Ask a model for what it would never say, by the way in which programs are asked for.

    Raises:
        ModelError: the server takes no constraint, or passes over it.
    """
    manner = model.manner
    if manner.constraint is None:
        raise _unproven(model, f"a server of dialect {manner.dialect.name!r} takes no grammar")
    for time in range(_TIMES):
        draw = stream(seed, f"canary {time}")
        words = tuple(f"k-{int(draw.integers(16**8)):08x}" for _ in range(2))
        try:
            said = model.answer(_PROMPT, _language(words), max_tokens=_MAX_TOKENS, seed=seed)
        except ModelError as error:
            if not _REFUSED.search(str(error)):
                raise
            raise _unproven(model, str(error)) from error
        text = said.text.strip()
        if text not in words or said.finish != "stop":
            raise _unproven(model, _failing(words, text, said.finish, said.reasoning))


def _language(words: tuple[str, ...]) -> Language:
    admitted = [f"{word}\n" for word in words]

    def read(answer: str) -> str | None:
        found = re.fullmatch(r'\s*\{\s*"k"\s*:\s*"(k-[0-9a-f]{8})"\s*\}\s*', answer)
        return f"{found[1]}\n" if found else None

    return Language(
        grammar=f"root ::= {any_of(admitted)}",
        schema=object_schema({"k": {"type": "string", "enum": list(words)}}),
        read=read,
        admits=admitted.__contains__,
        begins=lambda text: any(word.startswith(text) for word in admitted),
    )


def _failing(words: tuple[str, ...], text: str, finish: str, reasoning: str) -> str:
    asked = f"held to {words[0]!r} or {words[1]!r}, it said {text[:60]!r}"
    if any(word in reasoning for word in words):
        return f"{asked} and put the word into its thought (thinking = 'on' may help)"
    return f"{asked} (finish {finish!r})"


def _unproven(model: HostedLanguageModel, why: str) -> ModelError:
    thinks = "thinking = 'off' where the model has no <think>; " if model.manner.thinks else ""
    return ModelError(
        f"{model.name} at {model.host}: answers are not held to programs: {why}\n"
        f"  To fix: {thinks}constraint = 'free' under [models] (--no-constrained) samples and"
        " reads them; or see the servers in docs/plugins/hosted.md that hold answers to a grammar"
    )
