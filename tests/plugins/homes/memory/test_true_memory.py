"""Beliefs that age and give way; the log of episodes; likely places."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from karma.household.places import HAND
from karma.plugins.homes.memory.ageing import (
    OF_THINGS,
    Ageing,
    HomePrior,
    OwnTime,
    PlaceShares,
    TypePrior,
)
from karma.plugins.homes.memory.beliefs import Beliefs
from karma.plugins.homes.memory.episodes import Belief, EpisodeLog, EpisodeQuery
from karma.plugins.homes.memory.setting import sighting_text
from karma.plugins.homes.memory.true_memory import TrueMemory
from karma.plugins.homes.types import Deed
from karma.seeds import stream
from tests.support.lived import (
    DAY_S,
    HOUR_S,
    PLACES,
    LetterEmbedder,
    moment,
    seen,
    setting,
    where,
)

RESTLESS = {"Mug": TypePrior(moves=6.0, hours=30.0, places={})}
STILL = {"Mug": TypePrior(moves=0.002, hours=30.0, places={})}


def took(time_s):
    """Return that Ann takes the mug."""
    return Deed(
        time_s=time_s, who="Ann", action="PickupObject", object_id="Mug|1", object_type="Mug",
        place_id="CounterTop|1", room="kitchen_1",
    )  # fmt: skip


def beliefs(prior):
    return Beliefs(Ageing(prior))


# ----------------------------------------------------------------- beliefs


def test_what_is_not_there_is_evicted_with_its_reason():
    believed = beliefs(RESTLESS)
    believed.take_in(moment(9 * HOUR_S, seen("Mug|1", "Desk|1", 9 * HOUR_S)))
    believed.take_in(moment(15 * HOUR_S, looked_over=("Desk|1",)))
    found = believed.get("Mug|1")
    assert (found.ended_s, found.reason) == (15 * HOUR_S, "not there")


def test_of_what_never_moves_one_look_in_vain_leaves_a_doubt_and_two_evict():
    believed = beliefs(STILL)
    believed.take_in(moment(9 * HOUR_S, seen("Mug|1", "Desk|1", 9 * HOUR_S)))
    believed.take_in(moment(10 * HOUR_S, looked_over=("Desk|1",)))
    assert believed.get("Mug|1").ended_s is None
    assert believed.chance(believed.get("Mug|1"), 10 * HOUR_S) < 0.999
    for hour in (11, 12, 13, 14):
        believed.take_in(moment(hour * HOUR_S, looked_over=("Desk|1",)))
    assert believed.get("Mug|1").reason == "not there"


def test_seen_elsewhere_and_otherwise_correct_at_once():
    believed = beliefs(RESTLESS)
    believed.take_in(moment(1.0, seen("Mug|1", "Desk|1", 1.0)))
    believed.take_in(moment(2.0, seen("Mug|1", "Shelf|1", 2.0)))
    assert believed.get("Mug|1").reason == "seen elsewhere"
    believed.take_in(moment(3.0, seen("Mug|1", "Shelf|1", 3.0, ("dirty",))))
    assert believed.get("Mug|1").reason == "otherwise"


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 3), st.sampled_from(list(PLACES))), max_size=30))
def test_a_belief_is_the_last_sighting(steps):
    believed, last = beliefs(RESTLESS), {}
    for number, (which, place) in enumerate(steps):
        one = seen(f"Mug|{which}", place, float(number))
        believed.take_in(moment(float(number), one))
        last[one.object_id] = one
    assert {b.sighting.object_id: b.sighting for b in believed} == last


def test_what_a_resident_takes_along_is_nowhere_until_it_is_seen_again():
    memory = TrueMemory(setting())
    memory.take_in(moment(9 * HOUR_S, seen("Mug|1", "CounterTop|1", 9 * HOUR_S)))
    memory.take_in(moment(10 * HOUR_S, seen("Mug|1", HAND, 10 * HOUR_S), deed=took(10 * HOUR_S)))
    now = where("Mug", 10.5 * HOUR_S)
    assert [fact.ended_s for fact in memory.recall(now, 5)] == [10 * HOUR_S]
    likely = [one.place_id for one in memory.likely_places(now)]
    assert likely
    assert HAND not in likely
    told = memory.recall(where("Mug", 11 * HOUR_S, asked="who", action="PickupObject"), 5)
    assert [fact.deed.who for fact in told] == ["Ann"]
    memory.take_in(moment(12 * HOUR_S, seen("Mug|1", "Shelf|1", 12 * HOUR_S)))
    fact = memory.recall(where("Mug", 12 * HOUR_S), 1)[0]
    assert (fact.sighting.place_id, fact.ended_s) == ("Shelf|1", None)


def test_a_move_that_was_seen_from_taking_to_putting_is_learnt_once():
    ageing = Ageing(RESTLESS)
    believed = Beliefs(ageing)
    believed.take_in(moment(9 * HOUR_S, seen("Mug|1", "Desk|1", 9 * HOUR_S)))
    believed.take_in(moment(10 * HOUR_S, seen("Mug|1", HAND, 10 * HOUR_S), deed=took(10 * HOUR_S)))
    put = replace(took(10.1 * HOUR_S), action="PutObject", place_id="Shelf|1")
    believed.take_in(moment(10.1 * HOUR_S, seen("Mug|1", "Shelf|1", 10.1 * HOUR_S), deed=put))
    moves, _ = ageing.shown.get(OF_THINGS, "Mug|1")
    assert moves == 1


# ----------------------------------------------------------------- ageing


def test_hours_of_the_night_hardly_count():
    usual = OwnTime()
    assert usual.hours(8 * HOUR_S, 20 * HOUR_S) == pytest.approx(12.0)
    assert usual.hours(0.0, 6 * HOUR_S) < 0.5
    assert usual.hours(0.0, DAY_S) == pytest.approx(usual.hours(DAY_S, 2 * DAY_S))


@given(
    st.lists(st.floats(0, 3), min_size=48, max_size=48),
    st.integers(0, 9 * 24 * 60), st.integers(0, 9 * 24 * 60),
)  # fmt: skip
def test_own_time_is_what_the_minutes_between_count(by_hour, one, other):
    start, end = sorted((one, other))
    at = [(minute // 1440 % 7 >= 5) * 24 + minute // 60 % 24 for minute in range(start, end)]
    minutes = sum(by_hour[hour] / 60 for hour in at)
    assert OwnTime(by_hour).hours(start * 60.0, end * 60.0) == pytest.approx(minutes, abs=1e-6)


@given(st.floats(0, 1e6), st.floats(0, 1e6))
def test_more_time_never_makes_surer(a, b):
    ageing = Ageing(RESTLESS)
    short, long = sorted((a / 1000, b / 1000))
    assert ageing.stays("x", "Mug", short) >= ageing.stays("x", "Mug", long)
    assert 0.0 <= ageing.stays("x", "Mug", long) <= ageing.stays("x", "Mug", 0.0) == 1.0


@pytest.mark.parametrize("rate", [0.02, 0.15, 0.6])
def test_it_learns_how_often_things_move_and_is_calibrated(rate):
    rng = stream(1, "test", "ageing", str(rate))
    ageing = Ageing({"Mug": TypePrior(moves=1.0, hours=10.0, places={})})
    said, so = [], []
    for number in range(3_000):
        hours = float(rng.uniform(0.2, 10.0))
        if number >= 1_000:
            said.append(ageing.stays(f"Mug|{number % 5}", "Mug", hours))
        stayed = rng.random() < np.exp(-rate * hours)
        if number >= 1_000:
            so.append(float(stayed))
        ageing.learn(f"Mug|{number % 5}", "Mug", hours, moved=not stayed)
    said, so = np.array(said), np.array(so)
    assert abs(said.mean() - so.mean()) < 0.08
    blind = np.mean((so.mean() - so) ** 2)
    assert np.mean((said - so) ** 2) < blind * 1.02


# ----------------------------------------------------------------- the log


def filled(number=60):
    log = EpisodeLog(LetterEmbedder(), PLACES)
    kinds, places, rows = ("Mug", "Book", "Apple"), list(PLACES), []
    rng = stream(2, "test", "log")
    for at in range(number):
        kind, place = kinds[int(rng.integers(3))], places[int(rng.integers(len(places)))]
        start = float(at * 100)
        deed = None
        if at % 3 == 0:
            deed = Deed(
                time_s=start, who=("Ann", "Ben")[at % 2], action="PutObject",
                object_id=f"{kind}|{at}", object_type=kind,
            )  # fmt: skip
        states = ("dirty", "used up") if at % 4 == 0 else ()
        last = seen(f"{kind}|{at}", place, start + 50.0, states)
        one = Belief(sighting=last, since_s=start, deed=deed)
        log.begin(one)
        log.end(one)
        rows.append(one)
    return log, rows


QUERIES = [
    EpisodeQuery(types=("Mug",)),
    EpisodeQuery(types=("Mug", "Book"), after_s=1_000.0, before_s=3_000.0),
    EpisodeQuery(types=("Book",), state="used up"),
    EpisodeQuery(who="Ann", action="PutObject", after_s=500.0, before_s=4_000.0),
    EpisodeQuery(by_deed=True, before_s=2_500.0),
]


def fits(one, query):
    deed = one.deed
    start, end = one.since_s, one.sighting.time_s
    deeds = bool(query.who or query.action)
    return (
        (not query.types or one.sighting.object_type in query.types)
        and (not query.by_deed or deed is not None)
        and (not query.state or query.state in one.sighting.states)
        and (not query.who or (deed is not None and deed.who == query.who))
        and (not query.action or (deed is not None and deed.action == query.action))
        and (query.before_s is None or start <= query.before_s)
        and (query.after_s is None or (start if deeds else end) >= query.after_s)
    )


@pytest.mark.parametrize("query", QUERIES)
def test_the_log_finds_what_a_scan_finds(query):
    log, rows = filled()
    wanted = sorted((one for one in rows if fits(one, query)), key=lambda one: -one.since_s)
    assert log.recall(query, 1_000) == wanted
    assert log.recall(query, 3) == wanted[:3]
    assert wanted


@pytest.mark.parametrize("few", [0, 2_000])
def test_by_text_the_nearest_come_first_in_both_ways_of_searching(few, monkeypatch):
    monkeypatch.setattr("karma.plugins.homes.memory.episodes.FEW", few)
    log, rows = filled()
    query = EpisodeQuery(text="dirty used up mug, desk, bedroom", before_s=5_000.0)
    found = log.recall(query, 8)
    embedder = LetterEmbedder()
    asked = embedder.embed([query.text])[0]

    def near(one):
        return float(embedder.embed([sighting_text(one.sighting, PLACES)])[0] @ asked)

    wanted = sorted((one for one in rows if fits(one, query)), key=lambda one: -near(one))
    assert [round(near(one), 5) for one in found] == [round(near(one), 5) for one in wanted[:8]]


def test_retention_keeps_the_newest_and_what_goes_on():
    log = EpisodeLog(LetterEmbedder(), PLACES, most_episodes=100)
    log.begin(Belief(sighting=seen("Pen|0", "Desk|1", 0.0), since_s=0.0))
    for at in range(1_000):
        one = Belief(sighting=seen(f"Mug|{at}", "Desk|1", at + 1.0), since_s=at + 1.0)
        log.begin(one)
        log.end(one)
    kept = {one.sighting.object_id: one.since_s for one in log.episodes()}
    assert "Pen|0" in kept
    assert 90 <= len(kept) <= 101
    assert max(kept.values()) == 1_000.0
    assert min(since_s for since_s in kept.values() if since_s) > 890


# ----------------------------------------------------------------- likely places


@pytest.mark.parametrize("looked", [(), ("Shelf|1",), ("Shelf|1", "Desk|1", "CoffeeTable|1")])
def test_looks_that_do_not_show_it_elsewhere_make_surer(looked):
    """By Bayes, held against 200,000 things that were drawn to move so."""
    usual = {"bedroom/Desk": 0.3, "living/Shelf": 0.4, "kitchen/Drawer": 0.3}
    per_hour, seen_h, looked_h, asked_h = 0.2, 9.0, 14.0, 15.0
    kind = TypePrior(moves=1e6 * per_hour, hours=1e6, places=usual)
    prior = HomePrior(homes=1, types={"Mug": kind})
    memory = TrueMemory(setting(), prior=prior)
    memory.take_in(moment(seen_h * HOUR_S, seen("Mug|1", "CounterTop|1", seen_h * HOUR_S)))
    memory.take_in(moment(looked_h * HOUR_S, looked_over=looked))
    said = memory.recall(where("Mug", asked_h * HOUR_S), 1)[0].holds

    shares = PlaceShares(prior, PLACES)
    shares.visit("Mug|1", "Mug", "CounterTop|1")
    chances = shares.of(["Mug|1"], "Mug")
    names, rng = list(chances), stream(3, "test", "looks")
    weights = np.array(list(chances.values()))
    at = np.full(200_000, names.index("CounterTop|1"))
    in_sight = np.zeros(len(at), dtype=bool)
    for begun_h, over_h in ((seen_h, looked_h), (looked_h, asked_h)):
        moved = rng.random(len(at)) > np.exp(-per_hour * (over_h - begun_h))
        at = np.where(moved, rng.choice(len(names), size=len(at), p=weights), at)
        if over_h == looked_h:
            in_sight = np.isin(at, [names.index(one) for one in looked])
    drawn = (at[~in_sight] == names.index("CounterTop|1")).mean()
    assert said == pytest.approx(drawn, abs=0.04)


def test_places_that_were_looked_at_are_less_likely_and_habits_more():
    memory = TrueMemory(setting())
    for day in range(6):
        at = day * DAY_S + 10 * HOUR_S
        memory.take_in(moment(at, seen("Mug|1", ("Desk|1", "Shelf|1")[day % 2], at)))
    at = 6 * DAY_S + 12 * HOUR_S
    memory.take_in(moment(at, looked_over=("Shelf|1",)))
    chances = {one.place_id: one.chance for one in memory.likely_places(where("Mug", at + 60))}
    assert chances["Desk|1"] > 5 * chances["Shelf|1"]
    assert chances["Desk|1"] > max(chances[one] for one in ("CounterTop|1", "Drawer|1"))
