"""`karma read`: how a request is parsed."""

from karma.cli.shared import Json, argument, readable, tell, write_json
from karma.plugins.rules.method import reader_of
from karma.plugins.rules.types import Mention, Request, SaidDeed


def read(
    text: str = argument(..., "What somebody says, in quotes."),
    json: Json = None,
) -> None:
    """Say what a request asks for: form, deeds, things, what it rules out, times, conditions."""
    found = reader_of(None).read(readable(text))
    for request in found:
        for line in lines_of_request(request):
            tell(line)
    write_json(json, found)


def lines_of_request(one: Request) -> list[str]:
    """Return what a sentence was read as, a line for each thing that it says."""
    lines = [one.text, f"  form: {one.form}" + (f", lacks {one.lacking}" if one.lacking else "")]
    lines += [f"  to do: {_deed(deed)}" for deed in one.deeds]
    lines += [f"  not to do: {_deed(deed)}" for deed in one.forbidden]
    lines += [f"  ruled out: {_thing(thing)}" for thing in one.exclusions]
    lines += [f"  time: {time}" for time in one.times]
    for held in one.conditions:
        state = f"{_thing(held.thing)} is {held.state or '?'}" if held.thing else "not understood"
        lines.append(f"  only {held.text}: {'' if held.holds else 'not '}{state}")
    lines += [f"  not understood: {word}" for word in one.unread]
    return lines


def _deed(deed: SaidDeed) -> str:
    things = ", ".join(map(_thing, deed.things))
    place = f" {'near' if deed.near else 'to'} {_thing(deed.place)}" if deed.place else ""
    return f"{deed.deed or 'no skill for'} ({deed.verb}) {things}{place}".rstrip()


def _thing(one: Mention) -> str:
    kinds = "/".join(one.types) or ("whatever is there" if one.anything else "?")
    count = f" x {one.number}" if one.number else " all" if one.every else ""
    at = f", told by {'/'.join(one.at)}" if one.at else ""
    return f"{one.text!r} = {kinds}{count}{at}"
