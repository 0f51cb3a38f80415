"""Read object states by a hosted model: the paper's four steps (KARMA §3.4, Fig. 10)."""

from collections.abc import Mapping, Sequence
from typing import Any

from karma.contracts import Frame, SeenObject
from karma.errors import ModelError
from karma.infer.hosted.model import options_of, picture_name, said_in, sendable
from karma.infer.hosted.session import Endpoint, Session
from karma.infer.vision.pictures import picture_url
from karma.infer.vision.text import question, some_picture, states_told

MAX_TOKENS = 1024  # four steps of reasoning
ATTEMPTS = 2  # the second quotes what could not be used


class HostedVision:
    """A `VisionModel` at an endpoint that takes pictures.

    Args:
        endpoint: where, and which model; `api` must be "chat".
        session: the run's; by default one without a cassette.

    Raises:
        ModelError: the endpoint is not for chat.
        KarmaError: see `Session.admit`.
    """

    needs_pictures = True

    def __init__(self, endpoint: Endpoint, *, session: Session | None = None) -> None:
        if endpoint.api != "chat":
            raise ModelError(f'{endpoint.model}: pictures need api = "chat"')
        self.name = endpoint.model
        self._endpoint, self._session = endpoint, session or Session()
        self._session.admit(endpoint)

    def read_states(
        self, image: Frame | None, instruction: str, objects: Sequence[SeenObject]
    ) -> Mapping[str, tuple[str, ...]]:
        """Return object id -> state words; objects that the answer leaves out are left out.

        A cassette keeps size and hash of the picture in place of the picture.

        Args:
            image: shape (H, W, 3), RGB.
            instruction: the task.
            objects: of interest; () asks nothing.

        Raises:
            ModelError: there is no picture, the endpoint failed, or its answer has another form.
        """
        if not objects:
            return {}
        image = some_picture(self.name, image)
        role, text = question("full", sendable(instruction), objects)
        whole = {"type": "image_url", "image_url": {"url": picture_url(image)}}
        named = {"type": "image_url", "picture": picture_name(image)}

        def ask(said: Sequence[tuple[str, str]]) -> str:
            later = [{"role": role, "content": text} for role, text in said]
            sent, kept = (_first(role, text, picture) + later for picture in (whole, named))
            return self._ask(sent, named=kept)

        return states_told(ask, objects, ATTEMPTS)[0]

    def _ask(self, messages: list[dict[str, Any]], *, named: list[dict[str, Any]]) -> str:
        """Return the answer to messages; `named` has the picture's name in its place."""
        options = options_of(self._endpoint, MAX_TOKENS, 0.0, 0)
        exchange = self._session.ask(
            "vision",
            self._endpoint,
            "/chat/completions",
            {"messages": messages, **options},
            named={"messages": named, **options},
        )
        return said_in(exchange.reply.answer or {}, self._endpoint)[0]


def _first(role: str, text: str, picture: Mapping[str, Any]) -> list[dict[str, Any]]:
    return [
        {"role": "system", "content": role},
        {"role": "user", "content": [picture, {"type": "text", "text": text}]},
    ]
