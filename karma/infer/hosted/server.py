"""Find out who answers at an endpoint: its dialect, its models, its chat template."""

from collections.abc import Sequence
from difflib import get_close_matches
from fnmatch import fnmatchcase
from typing import Any

from karma.contracts import Thinking
from karma.errors import ModelError, ServerLost
from karma.infer.hosted.dialects import DIALECTS, Dialect, Manner
from karma.infer.hosted.session import Endpoint, Session

_SHOWN = 8  # models in a message


def manner_of(
    endpoint: Endpoint,
    session: Session | None = None,
    *,
    thinking: Thinking = "off",
    thinking_tokens: int = 1024,
) -> Manner:
    """Return how an endpoint's model is asked; without a session, by what the endpoint says alone.

    Args:
        endpoint: where, and which model.
        session: asks the server.
        thinking: whether a thinking model may think before it answers.
        thinking_tokens: of a thought at most.

    Raises:
        ModelError: there is no such model, the address is another one, the server cannot be
            reached, or it takes no such constraint.
    """
    dialect, known = DIALECTS.get(endpoint.dialect, DIALECTS["plain"]), False
    if session is not None:
        _check_listed(endpoint, session)
        found = _dialect_of(endpoint, session)
        dialect, known = found or dialect, found is not None
    constraint = endpoint.constraint or dialect.constraint
    if constraint is not None and constraint not in dialect.bindings:
        raise ModelError(
            f"{endpoint.model} at {endpoint.host}: a server of dialect {dialect.name!r} takes no"
            f" {constraint}\n  To fix: constraint is one of {', '.join(dialect.bindings) or 'none'}"
        )
    thinks, chat = thinking == "on", endpoint.api == "chat"
    opens = False
    if session is not None and thinks and chat and dialect.thought_in_grammar and known:
        opens = _opens_thought(dialect, endpoint, session)
    return Manner(
        dialect=dialect,
        constraint=constraint,
        thinks=thinks,
        thinking_tokens=thinking_tokens,
        chat=chat,
        opens_thought=opens,
        known=known,
    )


def slots_of(endpoint: Endpoint) -> int | None:
    """Return how many requests a server works on at once; None where it does not say.

    Raises:
        KarmaError: it may not or cannot be reached.
    """
    if endpoint.dialect not in ("auto", "llama-server"):
        return None
    session = Session()
    session.admit(endpoint)
    slots = (session.look(endpoint, "../props") or {}).get("total_slots")
    return slots if isinstance(slots, int) and slots > 0 else None


def _dialect_of(endpoint: Endpoint, session: Session) -> Dialect | None:
    """Return the dialect whose page the server has, of all or of the one that is named."""
    for one in DIALECTS.values():
        if one.page is not None and endpoint.dialect in ("auto", one.name):
            page, mark = one.page
            if mark in (session.look(endpoint, page) or {}):
                return one
    return None


def _opens_thought(dialect: Dialect, endpoint: Endpoint, session: Session) -> bool:
    """Return whether the model's chat template ends a prompt in `<think>`."""
    body = {"messages": [{"role": "user", "content": "Say yes."}], **dialect.thought}
    answer = session.ask("planner", endpoint, "../apply-template", body).reply.answer or {}
    return str(answer.get("prompt", "")).rstrip().endswith("<think>")


def _check_listed(endpoint: Endpoint, session: Session) -> None:
    """Compare model and address with what the server lists, if it lists anything.

    A list is no law: where a model is not in it, the server is asked as it would be.
    """
    names = _listed(session.look(endpoint, "/models"))
    if names is None:
        at_root = endpoint.base_url.rstrip("/") == endpoint.root
        if _listed(session.look(endpoint, "../v1/models" if at_root else "../models")) is None:
            return
        right = f"{endpoint.root}/v1" if at_root else endpoint.root
        raise ModelError(
            f"{endpoint.model} at {endpoint.host}: nothing answers at {endpoint.base_url}, but"
            f" models are listed at {right}\n  To fix: base_url = {right!r}"
        )
    if not names or _fits(endpoint.model, names) or _answers(endpoint, session):
        return
    shown = ", ".join(names[:_SHOWN]) + (" ..." if len(names) > _SHOWN else "")
    near = get_close_matches(endpoint.model, names, n=1, cutoff=0.0)
    raise ModelError(
        f"{endpoint.host} has no model {endpoint.model!r}; it lists {shown}"
        f"\n  To fix: model = {near[0]!r}"
    )


def _fits(model: str, names: Sequence[str]) -> bool:
    """Return whether a model is in a list, whose names may be patterns or lack a tag.

    >>> _fits("openai/good", ["openai/*"]), _fits("org/good:novita", ["org/good"])
    (True, True)
    """
    wanted = (model, f"{model}:latest", model.partition(":")[0])
    return any(fnmatchcase(one, name) for name in names for one in wanted)


def _answers(endpoint: Endpoint, session: Session) -> bool:
    """Return whether a server answers as a model that it does not list.

    Raises:
        ModelError: it fails in another way.
    """
    chat = endpoint.api == "chat"
    said: Any = {"messages": [{"role": "user", "content": "Yes"}]} if chat else {"prompt": "Yes"}
    body = {**said, "model": endpoint.model, endpoint.tokens_field: 1, **endpoint.extra}
    path = "/chat/completions" if chat else "/completions"
    try:
        session.ask("planner", endpoint, path, body, billed=False)
    except ServerLost:
        raise
    except ModelError:
        return False
    return True


def _listed(answer: dict[str, Any] | None) -> list[str] | None:
    """Return the names in a list of models; None where it is no such list."""
    match answer:
        case {"data": [*models]}:
            return [str(one["id"]) for one in models if isinstance(one, dict) and "id" in one]
        case _:
            return None
