"""The prompt of goal mode: a constant prefix with examples as turns, then the request."""

from collections.abc import Mapping, Sequence

from karma.agent.planning.full_profile import name_for
from karma.agent.tools.sights import unit_text
from karma.types.memory import Exchange, MemoryUnit
from karma.types.observation import SeenObject

SYSTEM = """\
You read requests to a household robot. Answer with what is to be true, a line for each:
put(X, Y)  near(X, Y)  hold(X)  clean(X)  heat(X)  cook(X)  cool(X)  slice(X)  fill(X)  coffee(X)
empty(X)  break(X)  open(X)  close(X)  on(X)  off(X)  trash(X)
if(X) only if there is such an X; avoid(X) not that X; tell(X) a question about X
ask("...") what is missing; refuse("...") why it cannot be done; note("...") nothing was asked
X is a name, with a count or all before it, and states or places behind it: 2 Mug dirty,
all Book in Shelf, Egg not in Fridge. "it" is what was used last.
"""

EXAMPLES: tuple[tuple[str, str, str], ...] = (
    ("", "put the apple in the fridge", "put(Apple, Fridge)"),
    ("", "Could you wash both mugs and leave them in the cabinet?",
     "clean(2 Mug)\nput(2 Mug, Cabinet)"),
    ("", "throw the old newspaper away", "trash(Newspaper)"),
    ("Apple in Fridge", "cut it up and bring me a piece", "slice(Apple)\nhold(Apple)"),
    ("", "Is the window open?", "tell(Window)"),
    ("", "Put all the books on the shelf except the one on the bed.",
     "avoid(Book in Bed)\nput(all Book, Shelf)"),
    ("", "Shut the box, would you, and set it on the sofa.", "close(Box)\nput(Box, Sofa)"),
    ("", "If there are eggs in the fridge, boil one, please.", "if(Egg in Fridge)\ncook(Egg)"),
    ("", "I'm home!", 'note("Welcome home.")'),
    ("", "Find my watch. It goes in the top drawer, not on the dresser.", "put(Watch, Drawer)"),
    ("", "How many forks do we have?", "tell(all Fork)"),
    ("Pen in Drawer_2; Mug at Sink (dirty)", "make me a coffee in the clean one",
     "coffee(Mug clean)"),
    ("", "Fill the vase with water and stand it on the table.",
     "fill(Vase)\nput(Vase, DiningTable)"),
    ("", "Hand me the thing from before.", 'ask("Which object do you mean?")'),
    ("", "Book me a table for two.", 'refuse("I cannot do that.")'),
    ("", "Leave the candle alone, but get all other lights off.", "avoid(Candle)\noff(all Light)"),
    ("", "Warm up a tomato, only not the one by the sink.",
     "avoid(Tomato in Sink)\nheat(Tomato)"),
    ("Plate at Sink", "toast some bread and put it on the plate", "cook(Bread)\nput(Bread, Plate)"),
)  # fmt: skip
"""Memory line, request, answer."""


def user_message(
    request: str,
    *,
    whole: str,
    units: Sequence[MemoryUnit],
    held: SeenObject | None,
    names: Mapping[str, str],
    exchanges: Sequence[Exchange],
) -> str:
    """Return the user message of a request; `names` maps names of known objects to ids."""
    name_of = {object_id: name for name, object_id in names.items()}
    used = [unit_text(unit, name_of) for unit in units if unit.handled][-4:]
    if held is not None:
        used.append(f"{name_for(held.object_id, name_of)} in the hand")
    lines = [f"Before: {exchange.request}" for exchange in exchanges[-2:]]
    lines.append(message(request if not whole else f"{request} (part of: {whole})", used))
    return "\n".join(lines)


def message(request: str, used: Sequence[str]) -> str:
    """Return memory line and request, as the examples have them."""
    memory = [f"Used last: {'; '.join(used)}"] if used else []
    return "\n".join([*memory, f"Request: {request}"])


def example_turns() -> tuple[tuple[str, str], ...]:
    """Return the examples as turns of user and assistant."""
    return tuple(
        (message(request, [memory] if memory else []), answer)
        for memory, request, answer in EXAMPLES
    )
