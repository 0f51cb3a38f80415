"""How many tokens the planner's prompts take, part by part, over floor plans: `full` fits 2,048.

Long-term memory has all furniture of a plan, as after a tour that overlooked nothing; short-term
memory holds ten things of it. After two failures: everything movable in the room has been seen by
then, two programs have failed and one search. Eight of our rooms, or with $KARMA_SAMPLE so many;
then AI2-THOR's floor plans where the reference data is. $KARMA_TOKENIZER is any
GGUF with a vocabulary, $KARMA_MAP "named" or "paper"; `-rP` shows the tables.
"""

import os
import re
from pathlib import Path
from statistics import median

from support.floor_plans import floor_plans
from support.paths import ROOT, SHARED

from karma.agent.planning.prompt import PROFILES, render
from karma.memory.scene_graph import SceneGraph
from karma.seeds import stream
from karma.types.memory import MemoryUnit
from karma.types.observation import SeenObject
from karma.types.planning import FailedProgram, PlanRequest
from karma.world.core.scene import load

SAMPLE = int(os.environ.get("KARMA_SAMPLE", "0"))
UNITS = 10
TOKENIZER = os.environ.get("KARMA_TOKENIZER", str(ROOT / "models/nano/planner.gguf"))
MAP = os.environ.get("KARMA_MAP", "named")
EXAMPLES = ("# Instruction: rinse", "# Instruction: slice", "# Instruction: warm")
STATES = ("cleaned", "sliced", "dirty", "filled", "heated")


def rooms():
    """What rooms are measured, in words, and the rooms."""
    if SAMPLE and (SHARED / "data").exists():
        scenes = list(floor_plans(SHARED, layouts=True))
        return f"{len(scenes)} floor plans", scenes
    kinds, count = ("kitchen", "living", "bedroom", "bathroom"), SAMPLE or 8
    names = [f"{kinds[number % 4]}_{number // 4 % 4 + 1}" for number in range(count)]
    return f"{count} of our rooms", [load(name) for name in names]


def counter():
    """How to count the tokens of a text."""
    from llama_cpp import Llama

    model = Llama(TOKENIZER, vocab_only=True, verbose=False)
    return lambda text: len(model.tokenize(text.encode(), add_bos=False))


def parts(asked, profile, count):
    """Return the tokens of each part of a prompt, by the line that opens it, and of all."""
    prompt = render(profile, asked).prompt
    whole = prompt.stable + prompt.changing
    found = {}
    for text in filter(None, re.split(r"^(?=#)", whole, flags=re.M)):
        opens = re.match(r"# ?([\w' -]+)", text)
        name = opens[1].strip() if opens else "role"
        name = name if profile == "full" else name.split()[0]
        name = "Examples" if text.startswith(EXAMPLES) else name
        found[name] = found.get(name, 0) + count(text)
    return {**found, "all": count(whole)}


def request(scene, again, form):
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


def failed_program(thing, seen):
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


def sight(thing):
    """Return a thing as an agent sees it, with the states of its door and its switch."""
    door = ("opened" if thing.openness else "closed",) if "openable" in thing.capabilities else ()
    switch = ("on" if thing.is_toggled else "off",) if "toggleable" in thing.capabilities else ()
    return SeenObject(
        object_id=thing.id, object_type=thing.type, position_m=thing.position,
        box_center_m=thing.center, box_size_m=thing.size, parent_ids=thing.parents,
        pickupable="pickupable" in thing.capabilities, states=door + switch,
        controls=thing.controls,
    )  # fmt: skip


def test_full_prompt_with_ten_units_fits_2048_tokens_in_the_median_room():
    where, scenes = rooms()
    count, medians = counter(), {}
    for again in (False, True):
        for profile in PROFILES:
            when = "after two failures" if again else "first request"
            print(f"\n{profile}, {when}, {where}, tokens of {Path(TOKENIZER).name}\n")
            print("| part | median | least | most |\n|---|---|---|---|")
            found = [parts(request(scene, again, MAP), profile, count) for scene in scenes]
            for name in dict.fromkeys(name for one in found for name in one):
                told = [one.get(name, 0) for one in found]
                print(f"| {name} | {median(told):.0f} | {min(told)} | {max(told)} |")
                medians[profile, again, name] = median(told)
    compact, full, goals = (medians[name, False, "all"] for name in ("compact", "full", "goals"))
    assert 0 < compact < 300
    assert 1000 < full <= 2048
    assert goals < 0.7 * full
