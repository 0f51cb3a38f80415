"""The prompt of tool mode: tools and facts, the map, memory, the conversation, the request."""

from collections.abc import Mapping, Sequence

from karma.agent.planning.full_profile import name_for
from karma.agent.tools.sights import unit_text
from karma.agent.tools.table import END_DOCS, TOOLS
from karma.types.memory import Exchange
from karma.types.observation import SeenObject
from karma.types.planning import PlanRequest

FACTS = (
    "on(Sink), then off(Sink) cleans and fills what is in it. A closed Fridge cools. A closed "
    "Microwave heats and cooks while on; so does a StoveBurner what is in a Pan or Pot on it, a "
    "Toaster bread. A CoffeeMachine that is on fills its Mug. Break an Egg before you cook it. To "
    "throw away, put into the GarbageCan. Open a container before you reach in. What you have seen "
    "without a mark in brackets is clean, empty, closed, off. pick, put and all others walk there."
)


def system_text(map_text: str) -> str:
    """Return the system message; it is the same for all requests while the map is."""
    tools = "; ".join(
        f"{tool.name}({', '.join(tool.arguments)})" + (f": {tool.doc}" if tool.doc else "")
        for tool in TOOLS.values()
    )
    ends = ", ".join(f'{kind}("{doc}")' for kind, doc in END_DOCS.items())
    furniture = f"Furniture, a line for each part of the room:\n{map_text}\n" if map_text else ""
    return (
        "You are a household robot with one arm. Answer with tool calls only, one a line; they run "
        f"until one fails, then you read the results.\n{tools}\nEnd with {ends}.\n{FACTS}\n"
        "Use the names given; a bare type (Cabinet) is the nearest of it. Do only what was asked. "
        "What look and find opened is closed again at the end; close what you opened yourself.\n"
        f"{furniture}"
    )


def first_message(
    request: PlanRequest,
    *,
    news: str,
    names: Mapping[str, str],
    held: SeenObject | None,
    exchanges: Sequence[Exchange],
) -> str:
    """Return the user message: sights, memory, conversation, and the request verbatim."""
    name_of = {object_id: name for name, object_id in names.items()}
    recalled = {item.unit.object_id for item in request.recalled}
    units = [
        ("*" if unit.object_id in recalled else "") + unit_text(unit, name_of)
        for unit in request.units
        if held is None or unit.object_id != held.object_id
    ]
    lines = [f"Seen: {news}"] if news else []
    lines.append(f"In the hand: {name_for(held.object_id, name_of) if held else 'nothing'}")
    if units:
        marked = " (* fits the request)" if recalled else ""
        lines.append(f"Remembered, the last used last{marked}: {'; '.join(units)}")
    for exchange in exchanges:
        lines += [f"Earlier request: {exchange.request}", f"  {exchange.report}"]
    if request.whole:
        lines.append(f"This is a part of: {request.whole}")
    lines.append(f"Request: {request.instruction}")
    return "\n".join(lines)
