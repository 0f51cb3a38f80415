"""Goals that count: their notation, and what they ask for, beside a search through all choices."""

from itertools import combinations, product

from hypothesis import given, settings
from hypothesis import strategies as st
from support.made_events import event, goals, thing, unmet

from karma.goals.goals import ARITY, MOST, GoalTracker, object_names, parse_goal, read_goal
from karma.types.tasks import Goal

DESKS = [thing(f"Desk|{i}", receptacle=True) for i in (1, 2)]


def pens(*desks, **fields):
    """Pens, each on the desk of that number, or on none."""
    return [
        thing(f"Pen|{i}", inside=[f"Desk|{on}"] if on else (), pickupable=True, **fields)
        for i, on in enumerate(desks)
    ]


# ----------------------------------------------------------------- the notation


NAMES = st.sampled_from(["Pen", "Apple", "Mug|1", "Mug/Cup", "AppleSliced"])


@st.composite
def any_goal(draw):
    predicate = draw(st.sampled_from(sorted(ARITY)))
    arguments = {
        "HOLDON": ("robot", draw(NAMES)),
        "STATE": (draw(NAMES), draw(st.sampled_from(["cleaned", "sliced", "used up"]))),
    }.get(predicate, tuple(draw(NAMES) for _ in range(ARITY[predicate])))
    count = 1 if predicate == "HOLDON" else draw(st.integers(1, MOST))
    return Goal(predicate=predicate, arguments=arguments, count=count)


@given(any_goal())
def test_goal_written_and_read_again_is_the_same(goal):
    assert parse_goal(str(goal)) == read_goal(str(goal)) == goal


# ----------------------------------------------------------------- what they ask for


def test_slices_of_a_crowded_table_are_counted_without_trying_every_set():
    plates = [thing(f"Plate|{i}", receptacle=True, pickupable=True) for i in range(8)]
    slices = [
        thing(f"Egg|{i}|EggCracked_0", objectType="EggCracked", inside=[f"Plate|{i % 8}"],
              isCooked=i % 3 == 0, isDirty=i % 5 == 0)
        for i in range(120)
    ]  # fmt: skip
    texts = ("9*ON(Egg, Plate)", "6*STATE(Egg, cooked)", "4*STATE(Egg, dirty)",
             "16*STATE(Egg, sliced)")  # fmt: skip
    assert unmet(event(*plates, *slices), *texts) == []  # 15 lie on a plate; C(120, 16) sets
    assert len(unmet(event(*plates, *slices), "16*ON(Egg, Plate)", *texts[1:])) == 1


def test_progress_counts_as_alfred_does():
    def progress(now, *texts):
        tracker = GoalTracker()
        tracker.start(now)
        return tuple(tracker.progress(goals(*texts), now))

    two = "2*ON(Pen, Desk)"
    assert [progress(event(*DESKS, *pens(*on)), two) for on in [(), (0, 0), (1, 2), (1, 1, 1)]] == [
        (0, 2), (0, 2), (1, 2), (2, 2),
    ]  # fmt: skip
    treated = ("ON(Pen, Desk)", "STATE(Pen, dirty)")
    placed, dirty = pens(1, 0)[0], pens(1, 0, isDirty=True)[1]
    assert progress(event(*DESKS, placed, dirty), *treated) == (2, 3)  # but not of one pen
    assert progress(event(*DESKS, *pens(1, isDirty=True)), *treated) == (3, 3)
    assert progress(event(*DESKS), "ON(Pen, Desk)", "OPEN(Drawer)") == (0, 2)


# ----------------------------------------------------------------- beside all choices


PLACES = ("Desk|1", "Desk|2", "Box|1")
WANTED = ("ON(Pen, Desk)", "ON(Pen, Desk/Box)", "ON(Cup, Desk)", "ON(Box, Desk)", "ON(Pen, Box)",
          "STATE(Pen, dirty)", "STATE(Cup, dirty)", "STATE(Pen/Cup, dirty)", "OPEN(Box)",
          "ON(Pen/Cup, Desk)")  # fmt: skip


@st.composite
def rooms(draw):
    flag = st.booleans()
    places = [
        thing(key, receptacle=True, pickupable=key == "Box|1", openable=key == "Box|1",
              isOpen=draw(flag), inside=["Desk|1"] if key == "Box|1" and draw(flag) else ())
        for key in PLACES
    ]  # fmt: skip
    kinds = draw(st.lists(st.sampled_from(["Pen", "Cup"]), max_size=5))
    moved = [
        thing(f"{kind}|{i}", pickupable=True, dirtyable=True, isDirty=draw(flag),
              inside=[where] if (where := draw(st.sampled_from([*PLACES, ""]))) else ())
        for i, kind in enumerate(kinds)
    ]  # fmt: skip
    return [*places, *moved]


def fewest_by_brute_force(room, wanted):
    """Return the fewest goals that fail over all choices of sets, by the words of the rule."""
    parents = {one["objectId"]: set(one["parentReceptacles"] or ()) for one in room}
    for key, above in parents.items():
        if "Box|1" in above:
            parents[key] = above | parents["Box|1"]
    by_id = {one["objectId"]: one for one in room}
    names = sorted({name for goal in wanted for name in object_names(goal)})
    sizes = {n: max([g.count for g in wanted if object_names(g)[0] == n], default=1) for n in names}
    meant = {n: [key for key in by_id if key.split("|")[0] in n.split("/")] for n in names}

    def true(goal, key, place):
        if goal.predicate == "ON":
            return place in parents[key]
        flag = "isOpen" if goal.predicate == "OPEN" else "isDirty"
        return by_id[key][flag]

    def holds(goal, chosen):
        first, *second = object_names(goal)
        places = chosen[second[0]] if second else [""]
        return any(sum(true(goal, key, at) for key in chosen[first]) >= goal.count for at in places)

    sets = [combinations(meant[n], min(sizes[n], len(meant[n]))) for n in names]
    choices = (dict(zip(names, choice, strict=True)) for choice in product(*sets))
    return min(sum(not holds(goal, chosen) for goal in wanted) for chosen in choices)


@settings(max_examples=300, deadline=None)
@given(
    rooms(),
    st.lists(st.tuples(st.integers(1, 3), st.sampled_from(WANTED)), min_size=1, max_size=4,
             unique_by=lambda one: one[1]),
)  # fmt: skip
def test_unmet_goals_are_as_few_as_some_choice_of_objects_allows(room, wanted):
    wanted = goals(*(f"{count}*{text}" for count, text in wanted))
    now, tracker = event(*room), GoalTracker()
    tracker.start(now)
    missed = tracker.unmet(wanted, now)
    assert len(missed) == fewest_by_brute_force(room, wanted)
    assert set(missed) <= set(wanted)
    met, of = tracker.progress(wanted, now)
    assert (met == of) is not missed
    assert 0 <= met <= of
