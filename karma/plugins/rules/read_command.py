"""The command `karma read`: print how a request is parsed."""

from karma.cli.shared import Json, argument, readable, tell, write_json
from karma.plugins.rules.method import reader_of
from karma.plugins.rules.types import Mention, Request, SaidDeed


def read(
    text: str = argument(..., "A request, in quotes."),
    json: Json = None,
) -> None:
    """Print how a request is parsed: form, actions, objects, exclusions, times, conditions."""
    requests = reader_of(None).read(readable(text))
    for request in requests:
        for line in lines_of_request(request):
            tell(line)
    write_json(json, requests)


def lines_of_request(request: Request) -> list[str]:
    """Return a parsed sentence, one line for each of its parts."""
    lacks = f", lacks {request.lacking}" if request.lacking else ""
    lines = [request.text, f"  form: {request.form}{lacks}"]
    lines += [f"  to do: {_action_text(deed)}" for deed in request.deeds]
    lines += [f"  not to do: {_action_text(deed)}" for deed in request.forbidden]
    lines += [f"  ruled out: {_object_text(mention)}" for mention in request.exclusions]
    lines += [f"  time: {time}" for time in request.times]
    for held in request.conditions:
        state = f"{_object_text(held.thing)} is {held.state or '?'}" if held.thing else ""
        negation = "" if held.holds else "not "
        lines.append(f"  only {held.text}: {negation}{state or 'not understood'}")
    lines += [f"  not understood: {word}" for word in request.unread]
    return lines


def _action_text(deed: SaidDeed) -> str:
    objects = ", ".join(map(_object_text, deed.things))
    place = f" {'near' if deed.near else 'to'} {_object_text(deed.place)}" if deed.place else ""
    return f"{deed.deed or 'no skill for'} ({deed.verb}) {objects}{place}".rstrip()


def _object_text(mention: Mention) -> str:
    types = "/".join(mention.types) or ("any object" if mention.anything else "?")
    count = f" x {mention.number}" if mention.number else " all" if mention.every else ""
    at = f", identified by location {'/'.join(mention.at)}" if mention.at else ""
    return f"{mention.text!r} = {types}{count}{at}"
