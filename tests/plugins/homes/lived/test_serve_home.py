"""Requests served in a home: things are brought, memory answers, stale beliefs give way."""

from dataclasses import replace

import pytest

from karma.plugins.homes.lived.body import HomeRobot
from karma.plugins.homes.lived.designs import DESIGNS
from karma.plugins.homes.lived.experiment import LivedRow
from karma.plugins.homes.lived.serve import Server
from karma.plugins.homes.memory.setting import MemorySetting
from karma.plugins.homes.residents import Household
from karma.plugins.homes.types import HomeQuestion, SaidThing
from karma.types.planning import Meaning
from tests.support.lived import HOUR_S, LetterEmbedder, small_home, small_map

TRUSTING = LivedRow(name="trusting", design="none", verify="never")
MEMORIES = ("ours", "last-seen", "append-only")


class Home:
    """A robot with a memory in a home where nobody lives; it has looked at all furniture."""

    def __init__(self, design, row=TRUSTING, rooms=2, seed=4):
        self.map = small_map(rooms, seed)
        self.household = Household(small_home(rooms, seed), seed=0, people=0, disturbance=0.0)
        given = MemorySetting(embedder=LetterEmbedder(), places=self.map.places)
        self.memory = DESIGNS[design](given)
        self.robot = HomeRobot(self.household, self.map, self.memory.take_in)
        self.server = Server(self.robot, self.memory, row, tokens=400)
        for place_id in self.map.places:
            self.robot.look_at(place_id)

    def where(self, object_id):
        """Return the furniture that a thing lies in or on, by the world itself."""
        return next(iter(self.household.world.state.objects[object_id].parents), None)

    def lonely(self):
        """Return the things that are alone of their type and lie straight on known furniture."""
        objects = self.household.world.state.objects.values()
        things = [one for one in objects if "pickupable" in one.capabilities]
        types = [one.type for one in things]
        return [
            one
            for one in things
            if types.count(one.type) == 1 and self.where(one.id) in self.map.places
        ]

    def asked(self, kind, asked="place", to=None, **said):
        """Return a request for a thing of a type, to be brought to a kind of place."""
        thing = SaidThing(phrase=kind.lower(), types=(Meaning(name=kind, similarity=1.0),), **said)
        place = self.map.places[to] if to else None
        goal = place and SaidThing(phrase=to, place_types=(place.place_type,), room=place.room)
        return HomeQuestion(
            text=f"the {kind.lower()}", speaker="Ann", time_s=self.robot.time_s, asked=asked,
            thing=thing, destination=goal,
        )  # fmt: skip

    def free_place(self, thing, but=()):
        """Return an open place of another type than where a thing lies, that takes it."""
        for place_id, place in self.map.places.items():
            here = self.map.places[self.where(thing.id)].place_type
            if place.openable or place_id in but or place.place_type == here:
                continue
            fork = self.household.fork().world
            fork.step("PickupObject", objectId=thing.id, forceAction=True)
            if fork.step("PutObject", objectId=place_id, forceAction=True):
                return place_id
        raise AssertionError("no place takes it")

    def move(self, thing, place_id):
        """Move a thing behind the robot's back."""
        world = self.household.world
        assert world.step("PickupObject", objectId=thing.id, forceAction=True)
        assert world.step("PutObject", objectId=place_id, forceAction=True)


@pytest.mark.parametrize("design", MEMORIES)
def test_an_errand_brings_the_thing(design):
    brought = 0
    for number in range(3):
        home = Home(design)
        thing = home.lonely()[number]
        goal = home.free_place(thing)
        before = home.robot.actions
        answer = home.server.serve(home.asked(thing.type, "errand", to=goal))
        assert home.robot.held is None
        assert home.robot.actions > before
        there = home.where(thing.id)
        assert answer.unknown == (there is None or answer.place_id != there)
        brought += there in home.map.places and (
            home.map.places[there].place_type == home.map.places[goal].place_type
        )
    assert brought == 3


@pytest.mark.parametrize("design", MEMORIES)
def test_a_question_is_answered_from_memory_without_a_step(design):
    home = Home(design)
    before = home.robot.actions
    things = home.lonely()
    right = 0
    for thing in things:
        answer = home.server.serve(home.asked(thing.type))
        right += answer.place_id == home.where(thing.id)
        assert home.server.effort.places == 0
    assert home.robot.actions == before
    assert len(things) > 8
    assert right >= 0.9 * len(things)


@pytest.mark.parametrize("design", MEMORIES)
def test_beside_what_is_in_the_hand_is_nowhere(design):
    home = Home(design)
    thing = home.lonely()[0]
    asked = home.asked(thing.type, "errand")
    beside = SaidThing(phrase="beside it", beside=asked.thing)
    answer = home.server.serve(replace(asked, destination=beside))
    assert answer.unknown
    assert home.robot.held is None


def test_who_always_looks_goes_there_first():
    home = Home("last-seen", LivedRow(name="sure", design="none", verify="always"))
    thing = home.lonely()[0]
    before = home.robot.actions
    answer = home.server.serve(home.asked(thing.type))
    assert home.robot.actions > before
    assert home.server.effort.believed == home.server.effort.places == 1
    assert answer.place_id == home.where(thing.id)


@pytest.mark.parametrize("design", MEMORIES)
def test_a_stale_belief_is_found_out_and_the_thing_is_brought_from_elsewhere(design):
    home = Home(design)
    thing = home.lonely()[0]
    old = home.where(thing.id)
    elsewhere = home.free_place(thing)
    home.move(thing, elsewhere)
    goal = home.free_place(thing, but=(old, elsewhere))
    answer = home.server.serve(home.asked(thing.type, "errand", to=goal))
    effort = home.server.effort
    assert not answer.unknown
    assert home.where(thing.id) == answer.place_id
    assert effort.stale >= 1
    assert effort.stale_actions > 0
    assert effort.places == effort.wasted + 1


def test_an_open_loop_gives_up_where_memory_was_wrong():
    home = Home(
        "last-seen", LivedRow(name="open", design="none", verify="never", closed_loop=False)
    )
    thing = home.lonely()[0]
    elsewhere = home.free_place(thing)
    home.move(thing, elsewhere)
    goal = home.free_place(thing, but=(elsewhere,))
    answer = home.server.serve(home.asked(thing.type, "errand", to=goal))
    assert answer.unknown
    assert home.server.effort.places == 1
    assert home.where(thing.id) == elsewhere


def test_what_ours_did_not_find_there_is_believed_there_no_more():
    home = Home("ours")
    thing = home.lonely()[0]
    old = home.where(thing.id)
    home.move(thing, home.free_place(thing))
    home.household.until(40 * HOUR_S)
    home.robot.look_at(old)
    facts = home.memory.recall(home.asked(thing.type), 64)
    newest = next(one for one in facts if one.sighting.object_id == thing.id)
    assert newest.ended_s is not None or (newest.holds or 0.0) < 0.5


def test_counts_come_from_memory():
    home = Home("last-seen")
    objects = home.household.world.state.objects
    kinds = [one.type for one in objects.values() if "pickupable" in one.capabilities]
    kind = max(set(kinds), key=lambda one: (kinds.count(one), one))
    before = home.robot.actions
    answer = home.server.serve(home.asked(kind, "count"))
    assert home.robot.actions == before
    assert kinds.count(kind) > 1
    assert answer.count == kinds.count(kind)


def test_what_is_unread_or_not_there_is_not_known():
    home = Home("ours")
    thing = home.lonely()[0]
    before = home.robot.actions
    unread = home.server.serve(replace(home.asked(thing.type), unread=("after dinner",)))
    assert (unread.unknown, unread.unread) == (True, ("after dinner",))
    assert home.server.serve(home.asked("TennisRacket")).unknown
    assert home.robot.actions == before
