"""Render prompts by a GGUF's own chat template, and let a model think before it answers.

Prompts are cut where their changing part begins. Tags of thoughts are those of
`karma.models.thoughts`. A grammar holds from behind the closing tag on, never inside the thought.
"""

from collections.abc import Callable
from contextlib import suppress
from datetime import datetime
from typing import Any, NamedTuple

from karma.errors import ModelError
from karma.models.checks.gguf import TEMPLATE
from karma.models.llama.answer import StreamingAnswer
from karma.models.llama.gguf_model import GgufModel
from karma.models.llama.opening import LlamaOptions
from karma.models.thoughts import GAP, TAGS, open_tag, tags_in
from karma.types.completion import Thinking
from karma.types.planning import Prompt

_MARK = "\ue000changing\ue000"  # private use: no template treats it specially
_FIX = "\n  To fix: chat = false in [models], or --set models.chat=false, opens it without"


def trial(path: str) -> None:
    """Do with a file all that a run does first; where that ends a process, it ends this one."""
    model = GgufModel(path, LlamaOptions(threads=1, gpu_layers=0), tried=True)
    prompt = Prompt(stable="Say yes.", changing="Now.")
    if TEMPLATE in model.metadata:
        with suppress(ModelError):  # a run can do without, and says why it must
            ChatTemplate(model).halves(prompt)
    model.evaluate([model.tokens(prompt.text, begins=True)])
    model.logits()


class ChatTemplate:
    """Renders prompts: `stable` is the system message, `changing` the user's.

    With `thinking` "off" a thought that the template opens is closed, and it is asked for none;
    with "on" one is opened where the template does not.

    Raises:
        ModelError: there is no template, or it knows no thoughts and `thinking` is "on".
    """

    def __init__(self, model: GgufModel, *, thinking: Thinking = "off") -> None:
        from llama_cpp.llama_chat_format import Jinja2ChatFormatter

        text = model.metadata.get(TEMPLATE)
        if text is None:
            raise ModelError(f"{model.name}: has no chat template{_FIX}")
        self.tags = tags_in(text)
        if thinking == "on" and self.tags is None:
            known = ", ".join(closing for _, closing in TAGS)
            raise ModelError(
                f"{model.name}: its chat template knows no tag that ends a thought ({known}); only"
                ' a model that was taught to think can\n  To fix: thinking = "off"'
            )

        class Formatter(Jinja2ChatFormatter):  # type: ignore[misc]
            @staticmethod
            def strftime_now(form: str) -> str:  # its date never changes
                return datetime(2025, 1, 1).strftime(form)

        word = model.llama._model.token_get_text
        bos, eos = model.llama.token_bos(), model.llama.token_eos()
        self._name, self._thinking = model.name, thinking
        self._form = _FORMS[0]  # that it took last
        try:
            self._renderer: Any = Formatter(
                template=text,
                bos_token=word(bos) if bos >= 0 else "",
                eos_token=word(eos) if eos >= 0 else "",
            )
        except Exception as error:
            reason = f"its chat template cannot be used: {str(error)[:200]}"
            raise ModelError(f"{model.name}: {reason}{_FIX}") from error

    def halves(self, prompt: Prompt) -> tuple[str, str]:
        """Return the rendered text before the changing part, and from there on.

        ModelError where the template refuses a plain conversation, or drops what it is given.
        """
        reason, switch = "", self._thinking == "on"
        for form in sorted(_FORMS, key=lambda one: one is not self._form):
            try:
                messages = _messages(prompt, *form)
                rendered = self._renderer(messages=messages, enable_thinking=switch)
                halves = rendered.prompt.split(_MARK)
            except Exception as error:  # noqa: BLE001 - a template can raise anything
                reason = str(error)
                continue
            if len(halves) == 2 and prompt.stable.strip() in halves[0]:
                self._form = form
                return halves[0], prompt.changing + prepared(halves[1], self._thinking, self.tags)
            reason = "it does not repeat what it is given"
        raise ModelError(f"{self._name}: its chat template cannot be used: {reason}{_FIX}")


_FORMS = ((True, False), (False, False), (True, True), (False, True))


def _messages(prompt: Prompt, system: bool, parts: bool) -> list[dict[str, Any]]:
    """Return the messages of a prompt whose changing part is the mark.

    Some templates refuse a system message, or drop it; those of picture models may read lists of
    parts only.
    """
    texts = [text for turn in prompt.turns for text in turn] + [_MARK]
    said = [(("user", "assistant")[number % 2], text) for number, text in enumerate(texts)]
    if system:
        said = [("system", prompt.stable), *said]
    else:
        said[0] = ("user", prompt.stable + texts[0])
    return [
        {"role": role, "content": [{"type": "text", "text": text}] if parts else text}
        for role, text in said
    ]


def prepared(ending: str, thinking: Thinking, tags: tuple[str, str] | None = TAGS[0]) -> str:
    r"""Return what a template ends a prompt with, so that a thought is open or closed as wanted.

    >>> prepared("assistant:<think>\n", "off")
    'assistant:<think>\n\n</think>\n\n'
    >>> prepared("assistant:", "on")
    'assistant:<think>\n'
    """
    opened = open_tag(ending)
    if thinking == "on" and tags is not None:
        return ending if opened else f"{ending}{tags[0]}\n"
    return f"{ending.rstrip()}\n\n{opened[1]}{GAP}" if opened else ending


class Thought(NamedTuple):
    """A model's thought."""

    text: str
    tokens: int  # that the model chose


def think(
    model: GgufModel, closing: str, budget: int, choose: Callable[[], int], answer: StreamingAnswer
) -> Thought:
    """Continue the thought that the evaluated prompt has opened, and close it.

    It ends where the model closes it, or would end its answer, or after `budget` tokens, or when
    time is up; what is then missing of the closing tag and the gap behind it is put there.
    ModelError as by `GgufModel.extend`.
    """
    thought, count, closed = b"", 0, False
    while count < budget and not closed and not answer.is_late:
        token = choose()
        if token in model.table.end_tokens:
            break
        count += 1
        thought += model.table.pieces[token]
        answer.came(model.table.pieces[token])
        model.extend([token])
        closed = closing.encode() in thought
    before, _, behind = thought.decode("utf-8", errors="replace").partition(closing)
    missing = GAP.removeprefix(behind) if closed else f"\n{closing}{GAP}"
    if missing:
        model.extend(model.tokens(missing, special=True))
    return Thought(before.strip(), count)
