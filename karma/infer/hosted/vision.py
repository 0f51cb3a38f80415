"""Read object states by a hosted model: the paper's four steps (KARMA §3.4, Fig. 10)."""

from collections.abc import Mapping, Sequence

from karma.contracts import Frame, SeenObject
from karma.errors import ModelError
from karma.infer.hosted.model import messages_of, options_of, said_in, sendable
from karma.infer.hosted.session import Endpoint, Session
from karma.infer.picture_questions import question, some_picture, states_told

MAX_TOKENS = 1024  # four steps of reasoning
ATTEMPTS = 2  # the second quotes what could not be used


class HostedVision:
    """A `VisionModel` at an endpoint that takes pictures.

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

        A cassette keeps size and hash of the picture, RGB of shape (H, W, 3), in its place.

        Raises:
            ModelError: there is no picture, the endpoint failed, or its answer has another form.
        """
        if not objects:
            return {}
        image = some_picture(self.name, image)
        role, text = question("full", sendable(instruction), objects)
        first = messages_of(role, text, [image], alone=False)
        place, options = self._endpoint, options_of(self._endpoint, MAX_TOKENS, 0.0, 0)

        def ask(said: Sequence[tuple[str, str]]) -> str:
            later = [{"role": role, "content": text} for role, text in said]
            body, named = ({"messages": [*one["messages"], *later], **options} for one in first)
            exchange = self._session.ask("vision", place, "/chat/completions", body, named=named)
            return said_in(exchange.reply.answer or {}, place)[0]

        return states_told(ask, objects, ATTEMPTS)
