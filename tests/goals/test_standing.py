"""When a placement counts, in worlds that are scripted event by event."""

import pytest

from karma.goals.goals import GoalTracker
from karma.types.tasks import SubTask
from tests.support.made_events import event, goals, thing

APPLE, PLATE, FRIDGE, TABLE = "Apple|1", "Plate|1", "Fridge|1", "DiningTable|1"


def moment(place, *, held="", plate_on=TABLE):
    """Return the event in which the apple is at a place, and something may be in the hand."""
    return event(
        thing(APPLE, inside=[place] if place else []),
        thing(PLATE, receptacle=True, pickupable=True, inside=[plate_on] if plate_on else []),
        thing(FRIDGE, receptacle=True),
        thing(TABLE, receptacle=True),
        held=[held] if held else [],
    )


ON_TABLE, IN_FRIDGE, TAKEN = moment(TABLE), moment(FRIDGE), moment(None, held=APPLE)
ON_PLATE = moment(PLATE)
CARRIED = moment(PLATE, held=PLATE, plate_on=None)
FALLEN = moment(None)


def judged(texts, events, *, before=ON_TABLE, passing=()):
    """Return what is unmet at the end of a sub-task in which these events came, in order."""
    wanted = goals(*texts)
    tracker = GoalTracker()
    tracker.start(before)
    subtask = SubTask(instruction="do it", goals=wanted, passing=goals(*passing))
    tracker.begin_subtask(subtask, before)
    for one in events:
        tracker.update(one)
    last = (before, *events)[-1]
    return [str(goal).removesuffix(": 1") for goal in tracker.unmet(wanted, last)]


COLD = "INSIDE(Apple, Fridge)"


@pytest.mark.parametrize(
    ("events", "counts"),
    [
        ([], False),
        ([TAKEN, IN_FRIDGE], True),
        ([TAKEN, IN_FRIDGE, TAKEN], False),  # undone on purpose
        ([TAKEN, IN_FRIDGE, TAKEN, ON_TABLE], False),
        ([TAKEN, IN_FRIDGE, FALLEN], True),  # nobody took it out
        ([TAKEN, IN_FRIDGE, FALLEN, TAKEN, ON_TABLE], False),  # and then somebody did
        ([TAKEN, IN_FRIDGE, TAKEN, IN_FRIDGE], True),
    ],
)
def test_placement_counts_that_held_and_was_not_undone_on_purpose(events, counts):
    assert judged([COLD], events) == ([] if counts else [COLD])


def test_placement_from_before_its_sub_task_counts_while_it_stays():
    assert judged([COLD], [], before=IN_FRIDGE) == []
    assert judged([COLD], [FALLEN], before=IN_FRIDGE) == []
    assert judged([COLD], [TAKEN, ON_TABLE], before=IN_FRIDGE) == [COLD]


def test_what_lies_in_a_thing_that_is_taken_away_is_taken_away_on_purpose():
    assert judged(["ON(Apple, DiningTable)"], [ON_PLATE, CARRIED]) == ["ON(Apple, DiningTable)"]
    assert judged(["ON(Apple, Plate)"], [ON_PLATE, CARRIED]) == []


def test_goals_on_the_way_need_only_have_held():
    texts = [COLD, "ON(Apple, Plate)"]
    events = [TAKEN, IN_FRIDGE, TAKEN, ON_PLATE]
    assert judged(texts, events) == [COLD]
    assert judged(texts, events, passing=[COLD]) == []
    assert judged(texts, [TAKEN, ON_PLATE], passing=[COLD]) == [COLD]


def test_two_things_do_not_lend_each_other_what_held_of_them():
    other = "Apple|2"

    def both(place, at, *, clean):
        return event(
            thing(APPLE, inside=[place], dirtyable=True, isDirty=True),
            thing(other, inside=[at], dirtyable=True, isDirty=not clean),
            thing(FRIDGE, receptacle=True),
            thing(TABLE, receptacle=True),
        )

    texts = [COLD, "STATE(Apple, clean)"]
    start = both(TABLE, TABLE, clean=False)
    events = [both(FRIDGE, TABLE, clean=False), both(TABLE, TABLE, clean=True)]
    assert len(judged(texts, events, before=start, passing=[COLD])) == 1
    events.append(both(TABLE, FRIDGE, clean=True))
    assert judged(texts, events, before=start, passing=[COLD]) == []
