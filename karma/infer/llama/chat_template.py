"""Render prompts by a GGUF's own chat template, cut where their changing part begins."""

from datetime import datetime
from typing import Any

from karma.contracts import Prompt
from karma.errors import ModelError
from karma.infer.llama.gguf_model import GgufModel

_MARK = "\ue000changing\ue000"  # private use: no template treats it specially


class ChatTemplate:
    """Renders prompts: `stable` is the system message, `changing` the user's.

    Args:
        model: whose template it is.

    Raises:
        ModelError: there is none.
    """

    def __init__(self, model: GgufModel) -> None:
        from llama_cpp.llama_chat_format import Jinja2ChatFormatter

        text = model.llama.metadata.get("tokenizer.chat_template")
        if text is None:
            raise ModelError(f"{model.name}: has no chat template; open it with chat=False")

        class Formatter(Jinja2ChatFormatter):  # type: ignore[misc]
            @staticmethod
            def strftime_now(form: str) -> str:  # its date never changes
                return datetime(2025, 1, 1).strftime(form)

        word = model.llama._model.token_get_text
        bos, eos = model.llama.token_bos(), model.llama.token_eos()
        self._name = model.name
        self._renderer: Any = Formatter(
            template=text,
            bos_token=word(bos) if bos >= 0 else "",
            eos_token=word(eos) if eos >= 0 else "",
        )

    def halves(self, prompt: Prompt) -> tuple[str, str]:
        """Return the rendered text before the changing part, and from there on.

        Raises:
            ModelError: the template refuses a plain conversation, or drops what it is given.
        """
        stable, reason = prompt.stable, ""
        system = (("system", stable), ("user", _MARK))
        user = (("user", stable + _MARK),)
        # some templates refuse or drop a system message, some a text that is no list of parts
        for said, form in ((system, _text), (user, _text), (system, _parts), (user, _parts)):
            messages = [{"role": role, "content": form(text)} for role, text in said]
            try:
                halves = self._renderer(messages=messages).prompt.split(_MARK)
            except Exception as error:  # noqa: BLE001 - a template can raise anything
                reason = str(error)
                continue
            if len(halves) == 2 and stable.strip() in halves[0]:
                return halves[0], prompt.changing + halves[1]
            reason = "it does not repeat what it is given"
        raise ModelError(f"{self._name}: its chat template cannot be used: {reason}")


def _text(text: str) -> str:
    return text


def _parts(text: str) -> list[dict[str, str]]:
    """Return a message as templates of picture models want it."""
    return [{"type": "text", "text": text}]
