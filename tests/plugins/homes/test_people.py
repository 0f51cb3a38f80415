"""People in a home: they move things while the agent is away, and it finds out by itself."""

from dataclasses import replace
from statistics import fmean

import pytest
from support.household import kitchen
from support.talking import AWAY, TAKE, agent_saying
from test_kept_home import gone, left

from karma.agent.seeing.perceive import digest_of
from karma.assistant.session_log import PastRequest
from karma.errors import KarmaError
from karma.files import to_json
from karma.household.ids import type_of
from karma.plugins.homes.memory.sighting_age import chance_in_place
from karma.plugins.homes.people import live
from karma.plugins.homes.types import HomeCard
from karma.plugins.rules.language.clock import DAY_S, HOUR_S
from karma.plugins.rules.talk.history import moves
from karma.types.memory import MemoryChange
from karma.types.observation import SeenObject
from karma.world.sim import EmbeddedWorld

SCENES = ("kitchen_1", "living_2", "bedroom_1", "bathroom_1")


def lived_in(scene, hours, *, people=2, seed=0):
    """The world after so many hours, and what was done in it."""
    world = EmbeddedWorld()
    world.reset(scene)
    card = HomeCard(scene=scene, people=people, seed=seed)
    return world, list(live(world, world, card, (0.0, hours * HOUR_S)))


def parents(world):
    return {
        one["objectId"]: one["parentReceptacles"]
        for one in world.last_event.metadata["objects"]
        if one["pickupable"]
    }


@pytest.mark.parametrize("scene", SCENES)
def test_what_people_did_is_made_again_by_its_actions_alone(scene):
    world, done = lived_in(scene, 72)
    again = EmbeddedWorld()
    again.reset(scene)
    before, pose = parents(again), again.last_event.metadata["agent"]
    assert all(again.step(action, **arguments) for action, arguments in done)
    assert digest_of(again.last_event) == digest_of(world.last_event)
    assert again.state.held is None
    assert again.last_event.metadata["agent"] == pose
    assert parents(again) != before
    assert lived_in(scene, 72)[1] == done != lived_in(scene, 72, seed=1)[1]


def test_people_let_a_thing_in_the_hand_be():
    world = EmbeddedWorld()
    world.reset("kitchen_1")
    thing = next(iter(parents(world)))
    assert world.step("PickupObject", objectId=thing, forceAction=True)
    held, card = digest_of(world.last_event), HomeCard(scene="kitchen_1", people=4)
    assert list(live(world, world, card, (0.0, 9 * DAY_S))) == []
    assert digest_of(world.last_event) == held


def test_home_with_people_is_the_same_after_them_and_memory_was_told_nothing(tmp_path):
    home = tmp_path / "home"
    agent = agent_saying(tmp_path, [TAKE, AWAY], home=home, people=4)
    agent.do("take the apple")
    agent.do("put it in the fridge")
    before = left(agent)
    gone(agent)
    again = agent_saying(tmp_path, [], home=home, later_s=5 * DAY_S)
    room, *remembered, clock = left(again)
    assert room != before[0]
    assert (remembered, clock) == (list(before[1:4]), before[4] + 5 * DAY_S)
    gone(again)
    assert left(agent_saying(tmp_path, [], home=home))[0] == room


def test_visit_killed_while_people_lived_is_as_if_it_had_not_been(tmp_path):
    home = tmp_path / "home"
    agent = agent_saying(tmp_path, [TAKE], home=home, people=4)
    agent.do("take the apple")
    agent.undo()
    gone(agent)
    before = (home / "log.jsonl").read_bytes()
    first = agent_saying(tmp_path, [], home=home, later_s=3 * DAY_S)
    room = left(first)[0]
    gone(first)
    data = (home / "log.jsonl").read_bytes()
    assert data.startswith(before)
    for cut in (len(before), len(before) + 1, len(data) - 1):
        (home / "log.jsonl").write_bytes(data[:cut])
        again = agent_saying(tmp_path, [], home=home, later_s=3 * DAY_S)
        assert left(again)[0] == room
        gone(again)


def test_other_people_or_too_many_are_refused(tmp_path):
    gone(agent_saying(tmp_path, [], home=tmp_path / "home", people=2))
    with pytest.raises(KarmaError, match=r"of 2 people, not of 3\n.*--people 2"):
        agent_saying(tmp_path, [], home=tmp_path / "home", people=3)
    with pytest.raises(KarmaError, match="0 to 4"):
        agent_saying(tmp_path, [], home=tmp_path / "other", people=9)
    assert not (tmp_path / "other").exists()


def moved_home(tmp_path, answers):
    """A home of people in which the apple, put away, was brought back to the table."""
    home = tmp_path / "home"
    agent = agent_saying(tmp_path, [TAKE, AWAY], home=home, people=1)
    agent.do("take the apple")
    agent.do("put it in the fridge")
    gone(agent)
    things = {one.type: one.id for one in kitchen().objects}
    done = [
        ("OpenObject", things["Fridge"]), ("PickupObject", things["Apple"]),
        ("CloseObject", things["Fridge"]), ("PutObject", things["DiningTable"]),
    ]  # fmt: skip
    actions = tuple((name, {"objectId": at, "forceAction": True}) for name, at in done)
    line = PastRequest(said="", status="", at_s=0.0, room="", waited_s=30 * HOUR_S, actions=actions)
    with (home / "log.jsonl").open("ab") as log:
        log.write(to_json(line))
    return agent_saying(tmp_path, answers, home=home)


def test_belief_that_was_wrong_is_told_with_its_chance_and_found_out(tmp_path):
    agent = moved_home(tmp_path, ["OpenObject(robot, 'Fridge')\n" + TAKE])
    (line,) = agent.do("where is the apple?").parts[0].answer.lines
    assert "in the fridge, seen 1 day ago; people live here: 0." in line
    reply = agent.do("take the apple out of the fridge")
    wrong = "the apple was on the dining table, not in the fridge: somebody had moved it"
    assert wrong in repr(reply)
    (one, other) = [one for one in moves(agent.home.past) if one.said != "put it in the fridge"][
        -2:
    ]
    assert (one.said, other.said) == ("", "take the apple out of the fridge")


def apple_in(place):
    spot = (0.0, 0.0, 0.0)
    return SeenObject(
        object_id="Apple|1", object_type="Apple", position_m=spot, box_center_m=spot,
        box_size_m=spot, pickupable=True, parent_ids=(f"{place}|1",), states=(), controls=None,
    )  # fmt: skip


def seen_at(place, at_s):
    change = MemoryChange(scene="kitchen", at_s=at_s, seen=(apple_in(place),))
    return PastRequest(said="look", status="done", at_s=at_s, room="", changes=(change,))


def test_home_that_is_busier_than_others_is_trusted_less():
    days = [number * DAY_S for number in range(8)]
    still = [seen_at("Fridge", at_s) for at_s in days]
    busy = [
        seen_at(("Fridge", "DiningTable")[number % 2], at_s) for number, at_s in enumerate(days)
    ]
    apple, now_s = apple_in("Fridge"), days[-1] + DAY_S
    assert chance_in_place(busy, apple, days[-1], now_s) < chance_in_place(
        [], apple, days[-1], now_s
    )
    assert chance_in_place(still, apple, days[-1], now_s) > chance_in_place(
        [], apple, days[-1], now_s
    )


def test_chance_that_is_told_is_near_how_often_things_stay():
    """In homes that no prior was fitted on; things that are trusted less are moved more."""
    told = []
    for scene in SCENES:
        for seed in range(3):
            before, after = (
                parents(lived_in(scene, 0)[0]),
                parents(lived_in(scene, 26, seed=seed)[0]),
            )
            for name in before.keys() & after.keys():
                thing = replace(apple_in("x"), object_id=name, object_type=type_of(name))
                stays = before[name][:1] == after[name][:1]
                told.append((chance_in_place([], thing, 0.0, 26 * HOUR_S), stays))
    assert fmean(chance for chance, _ in told) == pytest.approx(fmean(s for _, s in told), abs=0.12)
    low, high = ([s for chance, s in told if (chance > 0.7) is above] for above in (False, True))
    assert min(len(low), len(high)) > 20
    assert fmean(low) < fmean(high) - 0.1
