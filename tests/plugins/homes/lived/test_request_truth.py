"""Requests mean what their words say: an oracle reads the words and replays the log by itself.

Covered: the thing meant is the only one that fits; every gold answer of every kind; what is told
apart as exact, changed and unseen; what is asked can be known from what the robot saw; and no
answer rests on deeds of after.
"""

from dataclasses import dataclass, replace
from typing import get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from karma.household.types import object_types
from karma.plugins.homes.lived.drawing import draw_request
from karma.plugins.homes.lived.request import (
    HomeView,
    LivedKind,
    answered_rightly,
    room_right,
)
from karma.plugins.homes.memory.setting import KnownPlace
from karma.plugins.homes.types import Deed, HomeAnswer, HomeMoment, Sighting
from karma.seeds import stream
from tests.support.lived import DAY_S, HOUR_S
from tests.support.lived_oracle import WordsOracle, dirty_at, places_at

OPEN_PLACES = {
    "CounterTop|1": "kitchen_1", "SinkBasin|1": "kitchen_1", "DiningTable|1": "kitchen_1",
    "CoffeeTable|1": "living_1", "Shelf|1": "living_1", "Desk|1": "bedroom_1",
    "Desk|2": "bedroom_2", "SideTable|1": "bedroom_2", "CounterTop|2": "bathroom_1",
}  # fmt: skip
SHUT_PLACES = {"Drawer|1": "kitchen_1", "Cabinet|1": "kitchen_1"}
THINGS = (
    "Mug", "Mug", "Mug", "Plate", "Plate", "Bowl", "Cup", "Cup", "Book", "KeyChain",
    "RemoteControl", "Newspaper", "Pen", "Pen", "Apple", "Vase",
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class MadeHome:
    """A home of which only the log, the moments and the start exist."""

    places: dict[str, KnownPlace]
    start: dict[str, Sighting]
    log: tuple[Deed, ...]
    seen: tuple[HomeMoment, ...]
    people: tuple[str, ...] = ("Ann", "Ben", "Cleo")

    def view(self, time_s):
        """Return what requests are drawn from at a time."""
        return HomeView(
            time_s=time_s, people=self.people, places=self.places,
            log=tuple(one for one in self.log if one.time_s <= time_s),
            seen=tuple(one for one in self.seen if one.time_s <= time_s),
            now=self.sightings(time_s), start=self.start, takes=lambda thing, place: True,
            words="plain",
        )  # fmt: skip

    def sightings(self, time_s):
        """Return where all things are at a time."""
        where, dirty = (
            places_at(self.start, self.log, time_s),
            dirty_at(self.start, self.log, time_s),
        )
        return {key: self.sighting(key, where[key], dirty[key], time_s) for key in self.start}

    def sighting(self, key, place_id, is_dirty, time_s):
        """Return one thing as it is."""
        room = self.places[place_id].room if place_id in self.places else ""
        return Sighting(
            time_s=time_s, object_id=key, object_type=key.split("|")[0], place_id=place_id,
            room=room, position_m=(0.0, 0.0, 0.0), states=("dirty",) if is_dirty else (),
        )  # fmt: skip


def made_home(seed, days=5, deeds=12):
    """Return a home whose things are moved by chance; the robot sees half of it, and rounds."""
    rng = np.random.default_rng([seed, 77])
    rooms = OPEN_PLACES | SHUT_PLACES
    places = {
        key: KnownPlace(
            place_id=key, place_type=key.split("|")[0], room=room,
            room_kind=room.split("_")[0], openable=key in SHUT_PLACES,
        )
        for key, room in rooms.items()
    }  # fmt: skip
    empty = MadeHome(places=places, start={}, log=(), seen=())
    ids = [f"{kind}|{number}" for number, kind in enumerate(THINGS)]
    start = {
        key: empty.sighting(key, _some_place(rng, key, places, None), rng.random() < 0.4, 0.0)
        for key in ids
    }
    home = MadeHome(places=places, start=start, log=(), seen=())
    log, witnessed = _lived(rng, home, days, deeds)
    home = MadeHome(places=places, start=start, log=log, seen=())
    moments = [HomeMoment(time_s=6 * HOUR_S, room="kitchen_1", seen=tuple(start.values()))]
    moments += [
        _round(home, day * DAY_S + hour * HOUR_S) for day in range(days) for hour in (9, 17.5)
    ]
    for deed in witnessed:
        shown = home.sightings(deed.time_s)[deed.object_id]
        moments.append(HomeMoment(time_s=deed.time_s, room=shown.room, seen=(shown,), deed=deed))
    moments.sort(key=lambda one: one.time_s)
    return MadeHome(places=places, start=start, log=log, seen=tuple(moments))


def _some_place(rng, key, places, but):
    types = object_types()
    thing = types[key.split("|")[0]]
    fitting = [
        one.place_id
        for one in places.values()
        if thing.fits(types[one.place_type]) and one.place_id != but
    ]
    return fitting[int(rng.integers(len(fitting)))]


def _lived(rng, home, days, deeds):
    """Return the deeds of some days, and those that the robot saw."""
    where = {key: one.place_id for key, one in home.start.items()}
    dirty = {key: bool(one.states) for key, one in home.start.items()}
    log, witnessed = [], []
    for day in range(days):
        for hour in np.sort(rng.uniform(7, 22.5, deeds)):
            key = list(where)[int(rng.integers(len(where)))]
            who = home.people[int(rng.integers(3))] if rng.random() < 0.9 else "robot"
            time_s = round(day * DAY_S + float(hour) * HOUR_S, 1)
            goal = _some_place(rng, key, home.places, where[key])
            steps = [("PickupObject", where[key])]
            if object_types()[key.split("|")[0]].can("dirtyable") and rng.random() < 0.6:
                dirty[key] = not dirty[key]
                steps.append(("DirtyObject" if dirty[key] else "CleanObject", where[key]))
            steps.append(("PutObject", goal))
            saw = rng.random() < 0.5
            for number, (action, place_id) in enumerate(steps):
                deed = Deed(
                    time_s=time_s + number, who=who, action=action, object_id=key,
                    object_type=key.split("|")[0], place_id=place_id,
                )  # fmt: skip
                log.append(deed)
                witnessed += [deed] if saw else []
            where[key] = goal
    log.sort(key=lambda one: one.time_s)
    return tuple(log), witnessed


def _round(home, time_s):
    shown = tuple(one for one in home.sightings(time_s).values() if one.place_id in OPEN_PLACES)
    return HomeMoment(time_s=time_s, room="kitchen_1", seen=shown, looked_over=tuple(OPEN_PLACES))


KINDS = get_args(LivedKind)
ABOUT_S = HOUR_S  # how exact a time is to be told


def requests_of(homes, times=6):
    """Yield requests of all kinds with their home, drawn at several times of its days."""
    for seed in homes:
        home = made_home(seed)
        hours = stream(seed, "test", "asked").uniform(1.4 * DAY_S, 5 * DAY_S, times)
        for time_s in hours:
            view = home.view(float(time_s))
            for kind in KINDS:
                rng = stream(seed, "test", kind, str(int(time_s)))
                request = draw_request(view, kind, rng)
                if request is not None:
                    yield home, view, request


@pytest.fixture(scope="module")
def asked():
    return list(requests_of(range(12)))


def gold_of(request):
    """Return the answer that a request says is right."""
    middle = None if request.after_s is None else (request.after_s + request.before_s) / 2
    return HomeAnswer(
        place_id=request.places[0] if request.places else None, room=request.room,
        count=request.count, who=request.who, unknown=request.unknown, time_s=middle,
    )  # fmt: skip


def check(home, view, request):
    """Compare a request with what its words mean, by the whole log of its home."""
    oracle = WordsOracle(view, home.log, request.time_s)
    form, words = oracle.meaning(request)
    if form == "count":
        there = oracle.place_ids(words["at"])
        things = [
            key
            for key in view.start
            if plain_plural(key) == words["things"] and oracle.where[key] in there
        ]
        assert request.count == len(things)
        return
    things = oracle.things(words["thing"], request.speaker)
    if request.unknown:
        assert things == set()
        return
    assert things == set(request.object_ids), request.text
    (thing,) = things
    if form == "place":
        assert {oracle.where[thing]} == set(request.places), request.text
    elif form == "place_then":
        assert oracle.places_during(thing, words["span"]) == set(request.places), request.text
    elif form == "time":
        who = request.speaker if words["who"] == "I" else words["who"]
        last = oracle.deeds(thing, who, words["do"])[-1]
        assert request.after_s == last.time_s - ABOUT_S
        assert request.before_s == last.time_s + ABOUT_S
    elif form == "who":
        moves = [one for one in oracle.deeds(thing) if one.action in ("PickupObject", "PutObject")]
        assert request.who == moves[-1].who
    else:
        assert set(request.destinations) == oracle.place_ids(words["to"]), request.text
        assert oracle.where[thing] not in request.destinations


def plain_plural(key):
    """Return what several things of a type are called, for the types of made homes."""
    names = {"KeyChain": "key chains", "RemoteControl": "remote controls"}
    kind = key.split("|")[0]
    return names.get(kind, f"{kind.lower()}s")


def test_words_mean_what_the_request_says_is_right(asked):
    for home, view, request in asked:
        check(home, view, request)


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(100, 10_000), hours=st.floats(30, 119), kind=st.sampled_from(KINDS),
    draw=st.integers(0, 2**31),
)  # fmt: skip
def test_words_mean_what_is_right_in_any_home(seed, hours, kind, draw):
    home = made_home(seed)
    view = home.view(hours * HOUR_S)
    request = draw_request(view, kind, np.random.default_rng(draw))
    if request is not None:
        check(home, view, request)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 11), hours=st.floats(30, 110), kind=st.sampled_from(KINDS))
def test_no_answer_rests_on_what_happens_later(seed, hours, kind):
    """Later deeds of any sort change neither what is drawn nor what its words mean."""
    home, time_s = made_home(seed), hours * HOUR_S
    later = [one for one in home.log if one.time_s > time_s]
    undone = tuple(
        replace(one, who="Cleo", place_id="Desk|2") for one in later if one.action == "PutObject"
    )
    other = replace(home, log=(*(one for one in home.log if one.time_s <= time_s), *undone))
    first, again = (
        draw_request(one.view(time_s), kind, np.random.default_rng(seed)) for one in (home, other)
    )
    assert first == again
    if first is not None:
        check(other, other.view(time_s), first)


def test_what_is_asked_for_by_a_deed_was_seen_being_done(asked):
    """Questions for what happened can be answered from what the robot saw on rounds and waits."""
    checked = 0
    for _, view, request in asked:
        if request.kind == "event" or request.asked in ("time", "who"):
            deeds = [one.deed for one in view.seen if one.deed is not None]
            assert any(one.object_id in request.object_ids for one in deeds)
            checked += 1
    assert checked > 30


def test_the_judge_takes_the_truth_and_refuses_what_is_near_it(asked):
    for _, view, request in asked:
        gold = gold_of(request)
        if request.asked == "errand":
            assert not answered_rightly(request, gold, view.now)  # telling is not doing
            continue
        assert answered_rightly(request, gold, view.now)
        assert not answered_rightly(request, HomeAnswer(unknown=not request.unknown), view.now)
        assert request.unknown or not answered_rightly(request, HomeAnswer(), view.now)
        if request.asked == "place" and not request.unknown:
            assert room_right(request, gold, view.now)
            other = next(one for one in view.places.values() if one.room != request.room)
            wrong = HomeAnswer(place_id=other.place_id, room=other.room)
            assert not answered_rightly(request, wrong, view.now)
            assert not room_right(request, wrong, view.now)
        if request.asked == "time":
            for away_s in (-ABOUT_S - 1.0, ABOUT_S + 1.0):
                late = replace(gold, time_s=gold.time_s + away_s)
                assert not answered_rightly(request, late, view.now)
        if request.asked == "count":
            assert not answered_rightly(request, replace(gold, count=gold.count + 1), view.now)


def test_equal_draws_give_equal_requests():
    first, again = ([request for _, _, request in requests_of(range(3), times=3)] for _ in range(2))
    assert first == again
    assert len({request.text for request in first}) > len(first) / 2


def test_nothing_is_drawn_where_there_is_no_occasion():
    """At the first midnight nothing was seen: only what is not there can be asked for."""
    home = made_home(1)
    view = replace(home.view(60.0), seen=())
    for kind in KINDS:
        request = draw_request(view, kind, np.random.default_rng(0))
        assert (request is not None) == (kind == "unseen")


def test_a_deed_done_with_two_things_of_a_type_does_not_pick_one_out():
    """If Ann washed two mugs this morning, "the mug that Ann washed" is nobody's mug."""
    home = made_home(3)
    morning = 4 * DAY_S + 8 * HOUR_S
    washed = tuple(
        Deed(
            time_s=morning + number, who="Ann", action="CleanObject", object_id=f"Mug|{number}",
            object_type="Mug", place_id=None,
        )
        for number in range(2)
    )  # fmt: skip
    quiet = tuple(one for one in home.log if one.time_s < 4 * DAY_S)
    more = replace(home, log=(*quiet, *washed))
    shown = [one for one in home.seen if one.time_s < 4 * DAY_S]
    shown += [
        replace(shown[0], time_s=deed.time_s, seen=(more.sightings(deed.time_s)[deed.object_id],),
                deed=deed)
        for deed in washed
    ]  # fmt: skip
    view = replace(more.view(morning + 3 * HOUR_S), seen=tuple(shown))
    for number in range(60):
        request = draw_request(view, "event", np.random.default_rng(number))
        assert request is None or not (
            request.object_type == "Mug" and "this morning" in request.text
        )
