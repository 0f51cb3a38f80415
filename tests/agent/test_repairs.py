"""The full profile, told to a planner that reads: from each refusal to its repair, in the world.

The planner knows nothing but the prompt. Where a message lost the blocker, the remedy or the name,
it could not go on, and the test would fail.
"""

import re

import pytest
from support.experiences import begun
from support.household import kitchen, look, on, thing

from karma.types.completion import Completion, Decoding
from karma.types.events import Outcome, SkillResult
from karma.types.memory import Recalled
from karma.types.tasks import SubTask

CALL = re.compile(r"[A-Z]\w+\(robot, '[^']+'(?:, '[^']+')?\)")
MARK = "  # FAILED: "


class ReadingPlanner:
    """A `LanguageModel`: its first program is given, each next one is read out of the prompt.

    Args:
        first: its first program of each instruction, or how to write one from the prompt.
        repair: how a program is mended, from `Failed` to lines; it raises when the prompt lacks it.

    Attributes:
        prompts: what it was told, the changing part after the stable one.
    """

    name = "reading"

    def __init__(self, *first, repair=None):
        self._first = list(first)
        self._repair = repair or do_what_it_says
        self.prompts = []

    def complete(self, prompt, *, spec=None, **drawn):
        text = prompt.stable + prompt.changing
        self.prompts.append(text)
        assert "|" not in text, "an object id in the prompt"
        if "# Your last program failed" in text:
            program = "\n".join(self._repair(Failed(text)))
        else:
            first = self._first.pop(0)
            program = first if isinstance(first, str) else first(text)
        return Completion(
            text=program, finish="stop", prompt_tokens=None, reused_tokens=None,
            completion_tokens=None, first_token_s=None, total_s=0.0,
        )  # fmt: skip


class Failed:
    """What a prompt says of the last program: what is done, what failed and why, what is left."""

    def __init__(self, text):
        self.text = text
        body = text.partition("# Your last program failed\n")[2].partition("\n# ")[0]
        lines = body.splitlines()
        (number,) = [n for n, line in enumerate(lines) if MARK in line]
        self.before = [call_of(line) for line in lines[:number]]
        self.call, self.reason = lines[number].split(MARK, 1)
        self.rest = [call_of(line) for line in lines[number + 1 :]]
        self.ran = all(line.endswith("  # done") for line in lines[:number])
        assert self.ran or all(line.endswith("  # not run") for line in lines[:number])
        assert all(line.endswith("  # not run") for line in lines[number + 1 :])


def call_of(line):
    return line.partition("  #")[0]


def do_what_it_says(failed):
    """Do the first call that the refusal names, then the failed line again, then what is left."""
    remedy = CALL.search(failed.reason)
    assert remedy, f"no remedy in: {failed.reason}"
    return [remedy[0], failed.call, *failed.rest]


def section(text, title):
    """Return the lines of a prompt below a heading."""
    return text.partition(f"# {title}")[2].partition("\n# ")[0].splitlines()[1:]


def furniture(text):
    """Return name -> (x, y, z) of the map's furniture."""
    pattern = r"(\w+)\((-?[\d.]+),(-?[\d.]+),(-?[\d.]+)\)"
    found = re.findall(pattern, "\n".join(section(text, "Long-term memory")))
    return {name: tuple(map(float, point)) for name, *point in found}


TAKE = "GoToObject(robot, 'DiningTable')\nExplore(robot, '{0}')\nPickupObject(robot, '{0}')\n"


class LastUsed:
    """Recalls what was used last."""

    def recall(self, query, units, k):
        return [Recalled(unit=unit, similarity=0.0) for unit in units[::-1][:k]]


@pytest.fixture
def start(tmp_path):
    """A function that begins an episode in our kitchen, with more things in it."""

    def begin(planner, *extra, **options):
        decoding = Decoding(attempts=2, inspected=options.pop("inspected", False))
        return begun(
            tmp_path, planner, room=kitchen(extra), profile="full", decoding=decoding,
            recall=LastUsed(), **options,
        )  # fmt: skip

    return begin


def done(episode, instruction, whole=""):
    """Carry out an instruction that succeeds in the end; return its results."""
    events = list(episode.do(SubTask(instruction=instruction, whole=whole)))
    results = [one for one in events if isinstance(one, SkillResult)]
    assert isinstance(events[-1], Outcome)
    assert events[-1].finished, [(str(r.call), r.detail) for r in results if not r.ok]
    return results


def id_of(world, kind, number=0):
    found = [t["objectId"] for t in world.last_event.metadata["objects"] if t["objectType"] == kind]
    return found[number]


def parents(world, object_id):
    return look(world, object_id)["parentReceptacles"]


def side_tables():
    """Two tables that hold one thing each; a cup stands on the first."""
    one = thing("SideTable", (-0.4, 0.25, -1.5), (0.26, 0.5, 0.26))
    other = thing("SideTable", (0.6, 0.25, -1.5), (0.26, 0.5, 0.26))
    return one, other, on(one, "Cup", -0.4, -1.5, size=(0.2, 0.1, 0.2))


# ----------------------------------------------------------------- refusal, then repair


def test_closed_receptacle_is_opened_first(start):
    planner = ReadingPlanner(TAKE.format("Apple") + "PutObject(robot, 'Apple', 'Fridge')\n")
    episode, world = start(planner)
    done(episode, "put the apple in the fridge")
    assert id_of(world, "Fridge") in parents(world, id_of(world, "Apple"))
    assert "# FAILED: Fridge is closed; do OpenObject(robot, 'Fridge') first" in planner.prompts[1]


def test_full_hand_is_freed_first(start):
    planner = ReadingPlanner(TAKE.format("Apple") + "PickupObject(robot, 'Potato')\n")
    episode, world = start(planner)
    done(episode, "take the apple, then the potato")
    assert look(world, id_of(world, "Potato"))["isPickedUp"]
    assert "the hand holds Apple; put it down first" in planner.prompts[1]


def test_hand_with_another_thing_is_freed_and_takes_the_right_one(start):
    def repair(failed):
        put, take = CALL.findall(failed.reason)
        assert take == "PickupObject(robot, 'Potato')"
        return [put, take, failed.call]

    first = TAKE.format("Apple") + "PutObject(robot, 'Potato', 'CounterTop')\n"
    episode, world = start(ReadingPlanner(first, repair=repair))
    done(episode, "put the potato on the counter")
    assert id_of(world, "CounterTop") in parents(world, id_of(world, "Potato"))


@pytest.mark.parametrize(
    ("program", "state"),
    [
        ("OpenObject(robot, 'Microwave')\nToggleOn(robot, 'Microwave')\n", "isToggled"),
        ("ToggleOn(robot, 'Microwave')\nOpenObject(robot, 'Microwave')\n", "isOpen"),
    ],
)
def test_microwave_is_closed_or_switched_off_first(start, program, state):
    episode, world = start(ReadingPlanner(program))
    done(episode, "see to the microwave")
    assert look(world, id_of(world, "Microwave"))[state]


def test_thing_that_was_carried_off_is_explored(start):
    put = "PutObject(robot, 'Apple', 'CounterTop')\nGoToObject(robot, 'DiningTable')\n"
    planner = ReadingPlanner(TAKE.format("Apple") + put, "PickupObject(robot, 'Apple')\n")
    episode, world = start(planner)
    done(episode, "put the apple on the counter")
    fridge = id_of(world, "Fridge")
    world.step("OpenObject", objectId=fridge, forceAction=True)
    apple = id_of(world, "Apple")
    assert world.step("PickupObject", objectId=apple, forceAction=True)
    assert world.step("PutObject", objectId=fridge, forceAction=True)
    done(episode, "take the apple")
    assert look(world, apple)["isPickedUp"]
    assert "Apple is not where it was last seen, in or on CounterTop" in planner.prompts[2]


def test_slice_of_what_is_in_the_hand_waits_until_it_lies(start):
    def repair(failed):
        put, take = CALL.findall(failed.reason)
        assert "Apple is in the hand; put it down first, e.g. PutObject(robot" in failed.reason
        return [put, "Explore(robot, 'Knife')", take, failed.call]

    first = TAKE.format("Apple") + "SliceObject(robot, 'Apple')\n"
    episode, world = start(ReadingPlanner(first, repair=repair))
    done(episode, "slice the apple")
    assert id_of(world, "AppleSliced")


@pytest.mark.parametrize("inspected", [False, True])
def test_thing_that_does_not_fit_goes_where_the_refusal_says(start, inspected):
    told = []

    def repair(failed):
        place = failed.reason.partition("goes in or on ")[2].split(", ")[0]
        told.append(place)
        assert failed.ran is not inspected  # the inspector refuses before anything is done
        return [*([] if failed.ran else failed.before), f"PutObject(robot, 'Apple', '{place}')"]

    first = TAKE.format("Apple") + "PutObject(robot, 'Apple', 'Toaster')\n"
    episode, world = start(ReadingPlanner(first, repair=repair), inspected=inspected)
    done(episode, "put the apple away")
    assert id_of(world, *told) in parents(world, id_of(world, "Apple"))


def test_what_is_full_tells_what_could_be_taken_out(start):
    def repair(failed):
        put, take = CALL.findall(failed.reason)
        thing = take.split("'")[1]
        assert "Make room: put Potato down first" in failed.reason
        return [put, take,
                f"PutObject(robot, '{thing}', 'DiningTable')", "PickupObject(robot, 'Potato')",
                failed.call]  # fmt: skip

    first = TAKE.format("Potato") + "PutObject(robot, 'Potato', 'SideTable_1')\n"
    one, other, cup = side_tables()
    episode, world = start(ReadingPlanner(first, repair=repair), one, other, cup)
    done(episode, "put the potato on the first side table")
    assert one.id in parents(world, id_of(world, "Potato"))
    assert id_of(world, "DiningTable") in parents(world, cup.id)


def test_what_was_searched_for_in_vain_is_not_searched_for_again(start):
    def repair(failed):
        assert section(failed.text, "Searched for in vain") == ["Kettle"]
        (pan,) = [one for one in ("Kettle", "Pan") if one not in section(failed.text, "Searched")]
        return [f"Explore(robot, '{pan}')", f"PickupObject(robot, '{pan}')"]

    first = "Explore(robot, 'Kettle')\nPickupObject(robot, 'Kettle')\n"
    episode, world = start(ReadingPlanner(first, repair=repair))
    done(episode, "fetch the kettle, or a pan if there is none")
    assert look(world, id_of(world, "Pan"))["isPickedUp"]


def test_answer_that_does_not_parse_is_shown_with_its_line_marked(start):
    def repair(failed):
        assert "there is no skill Grab. " in failed.reason
        return [*failed.before, failed.call.replace("Grab", "PickupObject"), *failed.rest]

    first = TAKE.format("Apple").replace("PickupObject", "Grab")
    episode, world = start(ReadingPlanner(first, repair=repair))
    done(episode, "take the apple")
    assert look(world, id_of(world, "Apple"))["isPickedUp"]


def test_earlier_failures_stand_beside_the_last(start):
    """Two things are in the way one after the other; the third program avoids both."""

    def repair(failed):
        told = section(failed.text, "Failed before")
        closed = [line for line in told if "Fridge is closed; do OpenObject" in line]
        if not closed:
            return ["OpenObject(robot, 'Microwave')", "PutObject(robot, 'Apple', 'Toaster')"]
        assert "goes in or on" in failed.reason
        return ["OpenObject(robot, 'Fridge')", "PutObject(robot, 'Apple', 'Fridge')"]

    first = TAKE.format("Apple") + "PutObject(robot, 'Apple', 'Fridge')\n"
    planner = ReadingPlanner(first, repair=repair)
    episode, _ = start(planner)
    done(episode, "put the apple in the fridge")
    assert len(planner.prompts) == 3


# ----------------------------------------------------------------- what stands in the prompt


def test_second_plate_that_was_only_seen_has_a_name(start):
    table = next(one for one in kitchen().objects if one.type == "DiningTable")
    second = on(table, "Plate", 1.85, 0.05, size=(0.2, 0.02, 0.2))

    def repair(failed):
        (line,) = [x for x in section(failed.text, "Also seen") if x.startswith("DiningTable: ")]
        plates = [name for name in line.split(": ")[1].split(", ") if name.startswith("Plate")]
        assert len(plates) == 2
        return [f"PickupObject(robot, '{plates[1]}')", "PutObject(robot, 'Plate_2', 'CounterTop')"]

    look_first = "GoToObject(robot, 'DiningTable')\nPickupObject(robot, 'Spatula')\n"
    episode, world = start(ReadingPlanner(look_first, repair=repair), second)
    *_, put = done(episode, "put the second plate on the counter")
    moved = put.object_ids[0]
    assert look(world, moved)["objectType"] == "Plate"
    assert id_of(world, "CounterTop") in parents(world, moved)


def test_furniture_is_named_by_instance_and_place(start):
    """The planner finds "the side table right of the bin": to the left of who looks along -z."""

    def first(text):
        map_ = furniture(text)
        bin_x, _, _ = map_["GarbageCan"]
        right = [name for name, (x, _, _) in map_.items() if name.startswith("SideTable")
                 and x > bin_x]  # fmt: skip
        best = max(right, key=lambda name: map_[name][0])
        assert best == "SideTable_2"
        return TAKE.format("Apple") + f"PutObject(robot, 'Apple', '{best}')\n"

    one, other, _ = side_tables()
    episode, world = start(ReadingPlanner(first), one, other)
    done(episode, "put the apple on the side table that is farthest from the bin")
    assert other.id in parents(world, id_of(world, "Apple"))


def test_vessel_is_emptied_and_no_longer_remembered_as_filled(start):
    fill = (
        TAKE.format("Mug") + "PutObject(robot, 'Mug', 'Sink')\nToggleOn(robot, 'Faucet')\n"
        "ToggleOff(robot, 'Faucet')\nPickupObject(robot, 'Mug')\n"
    )
    planner = ReadingPlanner(fill, "EmptyObject(robot, 'Mug')\n", "EmptyObject(robot, 'Mug')\n")
    episode, world = start(planner)
    done(episode, "fill the mug")
    assert look(world, id_of(world, "Mug"))["isFilledWithLiquid"]
    done(episode, "pour it out")
    assert not look(world, id_of(world, "Mug"))["isFilledWithLiquid"]
    (again,) = done(episode, "pour it out")
    assert again.reason == "it is empty already"
    filled = [[line for line in section(text, "Short-term") if "filled" in line]
              for text in planner.prompts]  # fmt: skip
    assert [len(lines) for lines in filled] == [0, 1, 0]


def test_prompt_has_all_of_memory_unless_the_row_wants_only_what_is_recalled(start):
    look_about = "".join(f"Explore(robot, '{kind}')\n" for kind in ("Apple", "Mug", "Pan", "Bowl"))
    handle = "".join(
        f"PickupObject(robot, '{kind}')\nPutObject(robot, '{kind}', 'CounterTop')\n"
        for kind in ("Apple", "Potato", "Mug", "Bowl", "Knife")
    )
    for paper_prompt, count in ((False, 5), (True, 3)):
        planner = ReadingPlanner(look_about + handle, "GoToObject(robot, 'Fridge')\n")
        episode, _ = start(planner, paper_prompt=paper_prompt, seen_kept=0)
        done(episode, "handle five things")
        done(episode, "go to the fridge", whole="Handle five things and go to the fridge.")
        assert len(section(planner.prompts[1], "Short-term memory")) == count
        assert "# The user's whole request: Handle five things and go" in planner.prompts[1]
        assert "The user's whole request" not in planner.prompts[0]


def test_what_was_seen_stands_in_the_next_prompt_with_its_place_door_and_switch(start):
    look = "Explore(robot, 'Egg')\nToggleOn(robot, 'StoveBurner')\nOpenObject(robot, 'Cabinet')\n"
    planner = ReadingPlanner(look, "GoToObject(robot, 'Mug')\n")
    episode, _ = start(planner, seen_kept=0)
    done(episode, "look for the egg, light the stove and open the cabinet")
    done(episode, "go to the mug")
    places = dict(line.split(": ") for line in section(planner.prompts[1], "Also seen"))
    assert "Egg" in places["Fridge"].split(", ")
    assert "Bread" in places["DiningTable"].split(", ")
    told = dict(line.split(": ") for line in section(planner.prompts[1], "Doors and switches"))
    assert "Cabinet" in told["open"].split(", ")
    assert {"Drawer", "Microwave"} <= {*told["closed"].split(", ")}
    assert "StoveBurner" in told["on"]
    assert {"Faucet", "Microwave"} <= {*told["off"].split(", ")}


def test_map_of_the_paper_s_form_is_an_option(start):
    planner = ReadingPlanner("GoToObject(robot, 'Sink')\n")
    episode, _ = start(planner, paper_prompt=True)
    done(episode, "go to the sink")
    assert " <-> " in planner.prompts[0]
    ours = ReadingPlanner("GoToObject(robot, 'Sink')\n")
    episode, _ = start(ours)
    done(episode, "go to the sink")
    assert " <-> " not in ours.prompts[0]
