"""How many tokens the planner's prompts take, part by part, over floor plans.

    python scripts/measure_prompts.py [--tokenizer FILE.gguf ...] [--map paper] [--rooms 40]

Long-term memory has all furniture of a plan, as after a tour that overlooked nothing; short-term
memory holds ten things of it. The second table is the longest prompt that an instruction leads to:
everything movable in the room has been seen by then, two programs have failed and one search. A
tokenizer is any GGUF with a vocabulary. AI2-THOR's 120 floor plans come from the reference data;
without them, generated rooms of all kinds take their place, and the table says so.
"""

import os
import re
from collections.abc import Callable, Sequence
from functools import cache
from itertools import product
from pathlib import Path
from statistics import median
from typing import Annotated

import typer
from measuring import table

from karma.agent.prompt import PROFILES, render
from karma.contracts import FailedProgram, MemoryUnit, PlanRequest, SeenObject
from karma.memory.scene_graph import SceneGraph
from karma.offline import go_offline
from karma.seeds import stream
from karma.world.core.scene import Scene, SceneObject
from karma.world.generation.generate import build_scene
from karma.world.importing.scenes import import_dump

UNITS = 10
PLANNER = Path("models/nano/planner.gguf")
EXAMPLES = ("# Instruction: rinse", "# Instruction: slice", "# Instruction: warm")
STATES = ("cleaned", "sliced", "dirty", "filled", "heated")


def main(
    tokenizer: Annotated[list[Path] | None, typer.Option(help="A GGUF; may be repeated.")] = None,
    form: Annotated[str, typer.Option("--map", help='"named" or "paper".')] = "named",
    rooms: Annotated[int, typer.Option(help="Generated, if there is no plan.")] = 40,
) -> None:
    """Print a table for each tokenizer, profile and moment."""
    go_offline()
    where, scenes = plans(rooms)
    for path, again, profile in product(tokenizer or [PLANNER], (False, True), PROFILES):
        count = counter(path)
        when = "after two failures" if again else "first request"
        print(f"\n{profile}, {when}, {where}, tokens of {path.name}\n")
        found = [parts(request(scene, again, form), profile, count) for scene in scenes]
        names = dict.fromkeys(name for one in found for name in one)
        told = {name: [one.get(name, 0) for one in found] for name in names}
        table(
            "part | median | least | most",
            ((n, f"{median(some):.0f}", min(some), max(some)) for n, some in told.items()),
        )


def plans(count: int) -> tuple[str, list[Scene]]:
    """Return what rooms are measured, in words, and the rooms."""
    data = Path(os.environ.get("KARMA_SHARED", "../shared")) / "data"
    dumps = data / "thor5" / "scenes.jsonl.gz"
    if dumps.exists():
        scenes = list(import_dump(dumps, layouts=data / "alfred" / "layouts.json.gz"))
        return f"{len(scenes)} floor plans", scenes
    kinds = ("kitchen", "living", "bedroom", "bathroom")
    rooms = [build_scene(kinds[number % len(kinds)], number, 0) for number in range(count)]
    return f"{count} generated rooms", rooms


@cache
def counter(path: Path) -> Callable[[str], int]:
    """Return how to count the tokens of a text."""
    from llama_cpp import Llama

    model = Llama(str(path), vocab_only=True, verbose=False)
    return lambda text: len(model.tokenize(text.encode(), add_bos=False))


def parts(asked: PlanRequest, profile: str, count: Callable[[str], int]) -> dict[str, int]:
    """Return the tokens of each part of a prompt, by the line that opens it, and of all."""
    prompt = render(profile, asked).prompt
    whole = prompt.stable + prompt.changing
    found: dict[str, int] = {}
    for text in filter(None, re.split(r"^(?=#)", whole, flags=re.M)):
        opens = re.match(r"# ?([\w' -]+)", text)
        name = opens[1].strip() if opens else "role"
        name = name if profile == "full" else name.split()[0]
        name = "Examples" if text.startswith(EXAMPLES) else name
        found[name] = found.get(name, 0) + count(text)
    return {**found, "all": count(whole)}


def request(scene: Scene, again: bool, form: str) -> PlanRequest:
    """Return what is asked in a room, at first or after two failures."""
    rng = stream(0, "prompts", scene.name)
    graph = SceneGraph.over(scene.reachable, height_m=scene.floor_y, cell_m=scene.grid_m)
    seen = [sight(thing) for thing in scene.objects]
    graph.observe(seen)
    movable = [one for one in seen if one.pickupable]
    chosen = sorted(rng.permutation(len(movable))[:UNITS].tolist())
    units = tuple(
        MemoryUnit(
            object_id=one.object_id, object_type=one.object_type, position_m=one.position_m,
            states=tuple(STATES[: int(rng.integers(3))]),
            place_id=next(iter(one.parent_ids), None), handled=bool(rng.integers(2)),
        )
        for one in (movable[number] for number in chosen)
    )  # fmt: skip
    words = "No valid positions to place object found"
    program = failed_program(units[-1].object_id, seen)
    full = "it is full: there is Apple, Bread and Bowl in or on it. Put the thing elsewhere"
    stale = "it is not where it was last seen"
    failures = (
        FailedProgram(lines=program[:2], failed=1, reason=stale, ran=True),
        FailedProgram(lines=program, failed=4, reason=full, ran=True),
    )
    return PlanRequest(
        instruction="put the clean mug on the table right of the fridge",
        whole="Rinse the dirty mug, and then put the clean mug on the table right of the fridge.",
        areas=graph.areas(),
        graph_text=graph.to_text() if form == "paper" else "",
        units=units,
        held_id=units[-1].object_id,
        held_type=units[-1].object_type,
        error=f"PutObject(robot, 'Mug', 'Cabinet'): {words}" if again else "",
        failures=failures if again else (),
        missing=("Kettle",) if again else (),
        seen=seen if again else seen[: len(seen) // 2],
    )


def failed_program(thing: str, seen: Sequence[SeenObject]) -> tuple[str, ...]:
    """Return a program of eight lines about a thing."""
    place = next(one.object_id for one in seen if not one.pickupable)
    return (
        f"GoToObject(robot, '{thing}')",
        f"PickupObject(robot, '{thing}')",
        f"GoToObject(robot, '{place}')",
        f"OpenObject(robot, '{place}')",
        f"PutObject(robot, '{thing}', '{place}')",
        f"CloseObject(robot, '{place}')",
        "GoToObject(robot, 'Sink')",
        "ToggleOn(robot, 'Faucet')",
    )


def sight(thing: SceneObject) -> SeenObject:
    """Return a thing as an agent sees it, with the states of its door and its switch."""
    door = ("opened" if thing.openness else "closed",) if "openable" in thing.capabilities else ()
    switch = ("on" if thing.is_toggled else "off",) if "toggleable" in thing.capabilities else ()
    return SeenObject(
        object_id=thing.id, object_type=thing.type, position_m=thing.position,
        box_center_m=thing.center, box_size_m=thing.size, parent_ids=thing.parents,
        pickupable="pickupable" in thing.capabilities, states=door + switch,
        controls=thing.controls,
    )  # fmt: skip


if __name__ == "__main__":
    typer.run(main)
