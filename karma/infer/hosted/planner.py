"""Open a hosted planner: ask who answers, prove that it is held to programs."""

from karma.contracts import LanguageModel, Thinking
from karma.infer.hosted.canary import prove
from karma.infer.hosted.model import HostedLanguageModel
from karma.infer.hosted.server import manner_of
from karma.infer.hosted.session import Endpoint, Session


def open_planner(
    endpoint: Endpoint,
    *,
    session: Session | None = None,
    constrained: bool = False,
    thinking: Thinking = "off",
    thinking_tokens: int = 1024,
    seed: int = 0,
) -> LanguageModel:
    """Return the model at an endpoint.

    Args:
        endpoint: where, and which model.
        session: the run's; by default one without a cassette.
        constrained: the run relies on answers that are held to programs.
        thinking: this and the next: see `manner_of`.
        thinking_tokens: see there.
        seed: of the run.

    Raises:
        ModelError: see `manner_of` and, if `constrained`, `prove`.
        KarmaError: see `Session.admit`.
    """
    session = session or Session()
    session.admit(endpoint)
    manner = manner_of(endpoint, session, thinking=thinking, thinking_tokens=thinking_tokens)
    model = HostedLanguageModel(endpoint, session=session, manner=manner)
    if constrained:
        prove(model, seed)
    return model
