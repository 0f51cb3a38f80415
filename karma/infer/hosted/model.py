"""Fill the roles of planner and embedder over any OpenAI-compatible endpoint.

A hosted model takes no grammar: an answer is sampled, then parsed as any other, and what is wrong
with it stands in the next prompt (`karma.agent.planner`). `session` holds the line.
"""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, Literal

import numpy as np

from karma.contracts import Completion, ProgramSpec, Prompt, Vectors
from karma.errors import ModelError
from karma.infer.embed.rows import REMEMBERED, stacked, unit_row
from karma.infer.hosted.cassette import Exchange
from karma.infer.hosted.cost import cost_of, usage_of
from karma.infer.hosted.session import Endpoint, Session


class HostedLanguageModel:
    """A `LanguageModel` at an endpoint.

    `stable` is the system message, `changing` the user's; with `api = "completions"` they are one
    text, for models that have no chat template.

    Args:
        endpoint: where, and which model.
        session: the run's; by default one without a cassette.

    Raises:
        KarmaError: the endpoint may not or cannot be reached, see `Session.admit`.
    """

    def __init__(self, endpoint: Endpoint, *, session: Session | None = None) -> None:
        self.name = endpoint.model
        self._endpoint, self._session = endpoint, session or Session()
        self._session.admit(endpoint)

    def complete(
        self,
        prompt: Prompt,
        *,
        spec: ProgramSpec | None = None,
        max_tokens: int = 512,
        temperature: float = 0.0,
        seed: int = 0,
    ) -> Completion:
        """Continue the prompt; `spec` is not applied, since endpoints take no grammar.

        The time to the first token is not measured: answers come whole.

        Raises:
            ModelError: the endpoint failed, or its answer has another form.
        """
        stable, changing = sendable(prompt.stable), sendable(prompt.changing)
        if self._endpoint.api == "chat":
            path = "/chat/completions"
            messages = [{"role": "system", "content": stable}] if stable else []
            said: dict[str, Any] = {"messages": [*messages, _user(changing)]}
        else:
            path, said = "/completions", {"prompt": stable + changing}
        options = options_of(self._endpoint, max_tokens, temperature, seed)
        exchange = self._session.ask("planner", self._endpoint, path, {**said, **options})
        return _completion(exchange, self._endpoint)


class HostedEmbedder:
    """An `Embedder` at an endpoint: one text a request, each asked once a run.

    Args:
        endpoint: where, and which model.
        session: the run's; by default one without a cassette.

    Raises:
        KarmaError: see `Session.admit`.
    """

    def __init__(self, endpoint: Endpoint, *, session: Session | None = None) -> None:
        self.name = endpoint.model
        self._endpoint, self._session = endpoint, session or Session()
        self._session.admit(endpoint)
        self._row = lru_cache(maxsize=REMEMBERED)(self._ask)
        self._dimension: int | None = None

    @property
    def dimension(self) -> int:
        """How many numbers a row has; asks the endpoint if nothing was embedded yet."""
        if self._dimension is None:
            self._row("household")
        return self._dimension or 0

    def embed(self, texts: Sequence[str]) -> Vectors:
        """Return one row of length 1 per text, shape (n, dimension); n may be 0.

        Raises:
            ModelError: the endpoint failed, or its answer is no such row.
        """
        rows = [self._row(text) for text in texts]
        return stacked(rows, self.dimension)

    def _ask(self, text: str) -> Vectors:
        body = {"input": sendable(text), "model": self._endpoint.model, "encoding_format": "float"}
        body |= self._endpoint.extra
        for field in self._endpoint.omit:
            body.pop(field, None)
        exchange = self._session.ask("embedder", self._endpoint, "/embeddings", body, shared=True)
        row = self._checked(exchange.reply.answer)
        if self._dimension not in (None, row.size):
            raise _odd(self._endpoint, f"a row of {row.size} after rows of {self._dimension}")
        self._dimension = row.size
        return row

    def _checked(self, answer: Any) -> Vectors:
        try:
            row = np.asarray(answer["data"][0]["embedding"], dtype=np.float32)
        except (KeyError, IndexError, TypeError, ValueError) as error:
            raise _odd(self._endpoint, "no row of numbers") from error
        if row.ndim != 1:
            reason = "a row per token: it is served without pooling"
            raise _odd(self._endpoint, f"{reason} (shape {row.shape})")
        try:
            return unit_row(row)
        except ValueError as error:
            raise _odd(self._endpoint, str(error)) from error


# ----------------------------------------------------------------- what is sent


def sendable(text: str) -> str:
    """Return text that can be sent: no half characters."""
    return text.encode("utf-8", "replace").decode()


def _user(content: Any) -> dict[str, Any]:
    return {"role": "user", "content": content}


def options_of(
    endpoint: Endpoint, max_tokens: int, temperature: float, seed: int
) -> dict[str, Any]:
    """Return the fields of a request beside its text, as the endpoint wants them."""
    fields = {
        "model": endpoint.model,
        endpoint.tokens_field: max_tokens,
        "temperature": float(temperature),
        "seed": seed,
    }
    return {k: v for k, v in (fields | endpoint.extra).items() if k not in endpoint.omit}


# ----------------------------------------------------------------- what comes back


def _completion(exchange: Exchange, endpoint: Endpoint) -> Completion:
    answer = exchange.reply.answer or {}
    text, finish = said_in(answer, endpoint)
    usage = usage_of(answer)
    return Completion(
        text=text,
        finish=finish,
        prompt_tokens=usage.prompt_tokens,
        reused_tokens=usage.cached_tokens,
        completion_tokens=usage.completion_tokens,
        first_token_s=None,
        total_s=exchange.seconds,
        cost=cost_of(usage, endpoint.prices),
    )


def said_in(answer: Mapping[str, Any], endpoint: Endpoint) -> tuple[str, Literal["stop", "length"]]:
    """Return text and finish of an answer; a refusal's words are its text.

    Raises:
        ModelError: the answer has another form.
    """
    try:
        choice = answer["choices"][0]
        message = choice["message"] if endpoint.api == "chat" else {"content": choice["text"]}
        text = message.get("content") or message.get("refusal") or ""
    except (KeyError, IndexError, TypeError, AttributeError) as error:
        raise _odd(endpoint, "no choice with a text") from error
    if not isinstance(text, str):
        raise _odd(endpoint, f"a {type(text).__name__} where a text should be")
    return text, "length" if choice.get("finish_reason") == "length" else "stop"


def _odd(endpoint: Endpoint, what: str) -> ModelError:
    return ModelError(
        f"{endpoint.model} at {endpoint.host}: its answer holds {what}"
        "\n  To fix: see that base_url is that of an OpenAI-compatible server, and `api` what the"
        " model is for"
    )
