"""Fill the roles of planner, embedder and vision over any OpenAI-compatible endpoint.

`dialects` says who answers and how it is held to programs, `planner` proves it, and `connection`
holds the line.
"""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Literal

import numpy as np

from karma.errors import ModelError, RequestRefused
from karma.models.completeness import CUTS, cut_off, filtered
from karma.models.embed import REMEMBERED, stacked, unit_row
from karma.models.endpoint import Endpoint
from karma.models.picture_questions import picture_url, question, some_picture, states_told
from karma.models.session import Session
from karma.models.thoughts import split_thought
from karma.plugins.hosted.cassette import Exchange
from karma.plugins.hosted.connection import Connection
from karma.plugins.hosted.dialects import Language, Manner, language_of, manner_of
from karma.plugins.hosted.usage import cost_of, usage_of
from karma.types.completion import Completion, Heard, Listener
from karma.types.grammars import without_closing
from karma.types.observation import SeenObject
from karma.types.planning import AnswerSpec, JsonSpec, Prompt
from karma.types.space import Frame, Vectors

_VISION_TOKENS = 1024  # four steps of reasoning
_VISION_ATTEMPTS = 2  # the second quotes what could not be used
_FIELDS = ("reasoning_content", "reasoning", "thinking")  # that servers return a thought in
_SPOKEN = ("text", "output_text", "refusal", None)  # types of parts of a message
_THOUGHT = ("thinking", "reasoning")


@dataclass(frozen=True, slots=True, kw_only=True)
class Said:
    """What a model has said, its thought apart."""

    text: str
    finish: Literal["stop", "length", "filter"]
    reasoning: str
    exchange: Exchange


class HostedLanguageModel:
    """A `LanguageModel` at an endpoint.

    `stable` is the system message, `changing` the user's; with `api = "completions"` they are one
    text, for models that have no chat template. Without a manner it is asked as the endpoint says.

    Raises:
        KarmaError: the endpoint may not or cannot be reached, see `Connection.admit`.
    """

    def __init__(
        self, endpoint: Endpoint, *, session: Session | None = None, manner: Manner | None = None
    ) -> None:
        self.name, self.host = endpoint.model, endpoint.host
        self._endpoint, self._connection = endpoint, Connection(session)
        self._connection.admit(endpoint)
        self.manner = manner or manner_of(endpoint)
        self._no_system = False  # its server has refused a system message

    def complete(
        self,
        prompt: Prompt,
        *,
        spec: AnswerSpec | None = None,
        max_tokens: int = 512,
        max_seconds: float | None = None,
        temperature: float = 0.0,
        seed: int = 0,
        listen: Listener | None = None,
    ) -> Completion:
        """Continue the prompt; `spec` goes along in the form that the server takes, if any.

        Every answer is read all the same: one that is cut, or not of the language that it was to
        be held to, has a fault. Answers come whole: the time to the first token is not measured,
        `listen` hears them once, and the endpoint's `timeout_s` bounds them, not `max_seconds`.

        Raises:
            ModelError: the endpoint failed, or its answer has another form.
        """
        asked = self.manner.constraint is not None or isinstance(spec, JsonSpec)
        language = language_of(spec) if spec is not None and asked else None
        if self.manner.binding(language) is None:
            language = None
        said = self.answer(
            prompt, language, max_tokens=max_tokens, temperature=temperature, seed=seed
        )
        usage = usage_of(said.exchange.reply.answer or {})
        if listen is not None:
            seconds = said.exchange.seconds
            listen(Heard(text=said.text, tokens=usage.completion_tokens, seconds=seconds))
        fault = _fault(said, language, usage.completion_tokens)
        held = language is not None and not isinstance(spec, JsonSpec) and not fault
        return Completion(
            text=without_closing(said.text) if held else said.text,
            finish=said.finish,
            prompt_tokens=usage.prompt_tokens,
            reused_tokens=usage.cached_tokens,
            completion_tokens=usage.completion_tokens,
            first_token_s=None,
            total_s=said.exchange.seconds,
            cost=cost_of(usage, self._endpoint.prices),
            reasoning=said.reasoning,
            constrained=self._held(said, language),
            fault=fault,
        )

    def _held(self, said: Said, language: Language | None) -> bool | None:
        """Return whether a grammar held an answer; None where half a JSON text does not tell."""
        if language is None:
            return False
        if said.finish == "stop":
            return language.admits(said.text)
        return None if self.manner.binding(language) == "schema" else language.begins(said.text)

    def answer(
        self,
        prompt: Prompt,
        language: Language | None,
        *,
        max_tokens: int,
        temperature: float = 0.0,
        seed: int = 0,
    ) -> Said:
        """Return what the model says, held to a language if there is one; errors as above."""
        prompt = sendable_prompt(prompt)
        path = "/chat/completions" if self._endpoint.api == "chat" else "/completions"
        body: dict[str, Any] = {"prompt": prompt.text}
        kept = body
        if self._endpoint.api == "chat":
            body, kept = messages_of(prompt, alone=self._no_system)
        elif prompt.pictures:
            raise ModelError(f'{self.name}: pictures need api = "chat"')
        fields, room = self.manner.fields(language, max_tokens)
        options = options_of(self._endpoint, room, temperature, seed, fields)
        try:
            exchange = self._connection.ask(
                "planner", self._endpoint, path, {**body, **options}, named={**kept, **options}
            )
        except RequestRefused as error:
            if self._no_system or "messages" not in body or "system" not in str(error).lower():
                raise
            self._no_system = True  # its template has none, as Gemma's: said by the user then
            return self.answer(
                prompt, language, max_tokens=max_tokens, temperature=temperature, seed=seed
            )
        text, finish, reasoning = said_in(exchange.reply.answer or {}, self._endpoint)
        text = text.lstrip("\n")  # that a template leaves between thought and answer
        if language is not None and self.manner.binding(language) == "schema" and finish == "stop":
            text = language.read(text) or text
        return Said(text=text, finish=finish, reasoning=reasoning, exchange=exchange)


def _fault(said: Said, language: Language | None, tokens: int | None) -> str:
    """Return why an answer is no program, as far as that is known without parsing it."""
    if said.finish == "filter":
        return filtered()
    if said.finish == "length":
        return cut_off(tokens)
    if language is not None and not language.admits(said.text):
        return "the answer is not of the form that was asked for, or names what is not there"
    return ""


class HostedEmbedder:
    """An `Embedder` at an endpoint: one text a request, each asked once a run.

    KarmaError as by `Connection.admit`.
    """

    def __init__(self, endpoint: Endpoint, *, session: Session | None = None) -> None:
        self.name = endpoint.model
        self._endpoint, self._connection = endpoint, Connection(session)
        self._connection.admit(endpoint)
        self._rows = lru_cache(maxsize=REMEMBERED)(self._ask)
        self._dimension: int | None = None

    @property
    def dimension(self) -> int:
        """How many numbers a row has; asks the endpoint if nothing was embedded yet."""
        if self._dimension is None:
            self._row("household")
        return self._dimension or 0

    def embed(self, texts: Sequence[str]) -> Vectors:
        """Return one row of length 1 per text, shape (n, dimension); n may be 0.

        ModelError where the endpoint failed, or its answer is no such row.
        """
        rows = [self._row(text) for text in texts]
        return stacked(rows, rows[0].size if rows else self.dimension)

    def _row(self, text: str) -> Vectors:
        """Return the row of a text; what an episode asks depends on no earlier one's questions."""
        return self._rows(self._connection.session.cassette.scope, text)

    def _ask(self, _scope: str, text: str) -> Vectors:
        body = {"input": sendable(text), "model": self._endpoint.model, "encoding_format": "float"}
        body |= self._endpoint.extra
        for field in self._endpoint.omit:
            body.pop(field, None)
        exchange = self._connection.ask(
            "embedder", self._endpoint, "/embeddings", body, shared=True
        )
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
        try:
            if row.ndim != 1:
                reason = "a row per token: it is served without pooling"
                raise ValueError(f"{reason} (shape {row.shape})")
            return unit_row(row)
        except ValueError as error:
            raise _odd(self._endpoint, str(error)) from error


class HostedVision:
    """A `VisionModel` at an endpoint that takes pictures.

    Raises:
        ModelError: the endpoint is not for chat.
        KarmaError: see `Connection.admit`.
    """

    needs_pictures = True

    def __init__(self, endpoint: Endpoint, *, session: Session | None = None) -> None:
        if endpoint.api != "chat":
            raise ModelError(f'{endpoint.model}: pictures need api = "chat"')
        self.name = endpoint.model
        self._endpoint, self._connection = endpoint, Connection(session)
        self._connection.admit(endpoint)

    def read_states(
        self, image: Frame | None, instruction: str, objects: Sequence[SeenObject]
    ) -> Mapping[str, tuple[str, ...]]:
        """Return object id -> state words; objects that the answer leaves out are left out.

        A cassette keeps size and hash of the picture, RGB of shape (H, W, 3), in its place.

        Raises:
            ModelError: there is no picture, the endpoint failed, or its answer has another form.
        """
        if not objects:
            return {}
        image = some_picture(self.name, image)
        role, text = question("full", sendable(instruction), objects)
        asked = Prompt(stable=role, changing=text, pictures=(image,))
        first = messages_of(asked, alone=False)
        place, options = self._endpoint, options_of(self._endpoint, _VISION_TOKENS, 0.0, 0)

        def ask(said: Sequence[tuple[str, str]]) -> str:
            later = [{"role": role, "content": text} for role, text in said]
            body, named = ({"messages": [*one["messages"], *later], **options} for one in first)
            exchange = self._connection.ask("vision", place, "/chat/completions", body, named=named)
            return said_in(exchange.reply.answer or {}, place)[0]

        return states_told(ask, objects, _VISION_ATTEMPTS)


# ----------------------------------------------------------------- what is sent


def sendable(text: str) -> str:
    """Return text that can be sent: no half characters."""
    return text.encode("utf-8", "replace").decode()


def sendable_prompt(prompt: Prompt) -> Prompt:
    """Return a prompt whose texts can be sent."""
    return replace(
        prompt,
        stable=sendable(prompt.stable),
        changing=sendable(prompt.changing),
        turns=tuple((sendable(user), sendable(answer)) for user, answer in prompt.turns),
    )


def _with_pictures(text: str, pictures: Sequence[Frame]) -> tuple[Any, Any]:
    """Return a message with pictures before its text, and as a cassette keeps it."""
    if not pictures:
        return text, text
    said = {"type": "text", "text": text}
    whole = [{"type": "image_url", "image_url": {"url": picture_url(one)}} for one in pictures]
    named = [{"type": "image_url", "picture": picture_name(one)} for one in pictures]
    return [*whole, said], [*named, said]


def picture_name(image: Frame) -> str:
    """Return what stands for a picture in a cassette: size and SHA-256 of its pixels."""
    height, width, _ = image.shape
    pixels = np.ascontiguousarray(image, np.uint8).tobytes()
    return f"{width}x{height} {hashlib.sha256(pixels).hexdigest()}"


def messages_of(prompt: Prompt, *, alone: bool) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the messages of a prompt, and as a cassette keeps them; `alone`: no system message."""
    texts = [text for turn in prompt.turns for text in turn] + [prompt.changing]
    before: list[dict[str, Any]] = []
    if alone:
        texts[0] = prompt.stable + texts[0]
    elif prompt.stable:
        before.append({"role": "system", "content": prompt.stable})
    for number, text in enumerate(texts[:-1]):
        before.append({"role": ("user", "assistant")[number % 2], "content": text})
    whole, kept = (
        {"messages": [*before, {"role": "user", "content": content}]}
        for content in _with_pictures(texts[-1], prompt.pictures)
    )
    return whole, kept


def options_of(
    endpoint: Endpoint,
    max_tokens: int,
    temperature: float,
    seed: int,
    fields: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Return the fields of a request beside its text, as the endpoint wants them."""
    common = {
        "model": endpoint.model,
        endpoint.tokens_field: max_tokens,
        "temperature": float(temperature),
        "seed": seed,
    }
    said = common | dict(fields or {}) | endpoint.extra
    return {name: value for name, value in said.items() if name not in endpoint.omit}


# ----------------------------------------------------------------- what comes back


def said_in(
    answer: Mapping[str, Any], endpoint: Endpoint
) -> tuple[str, Literal["stop", "length", "filter"], str]:
    """Return text, finish and thought of an answer; a refusal's words are its text.

    ModelError where the answer has another form.
    """
    try:
        choice = answer["choices"][0]
        message = choice["message"] if endpoint.api == "chat" else {"content": choice["text"]}
        text, reasoning = told_apart(message)
        finish = choice.get("finish_reason")
    except (KeyError, IndexError, AttributeError) as error:
        raise _odd(endpoint, "no choice with a text") from error
    except TypeError as error:
        told = str(error) if "where a text" in str(error) else "no choice with a text"
        raise _odd(endpoint, told) from error
    return text, CUTS.get(str(finish), "stop"), reasoning


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
    inside, answer = split_thought(content)
    return answer, "\n".join(filter(None, [thought, inside]))


def _text_of(part: Mapping[str, Any]) -> str:
    """Return the text of a part of a message, which may have parts itself."""
    said = part.get("text", part.get("thinking", ""))
    inner = said if isinstance(said, list) else [said]
    return "".join(one if isinstance(one, str) else str(one.get("text", "")) for one in inner)


def _odd(endpoint: Endpoint, what: str) -> ModelError:
    return ModelError(
        f"{endpoint.model} at {endpoint.host}: its answer holds {what}"
        "\n  To fix: see that base_url is that of an OpenAI-compatible server, and `api` what the"
        " model is for"
    )
