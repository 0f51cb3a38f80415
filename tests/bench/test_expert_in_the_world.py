"""The expert in the world: one object for all goals of a name, and another way after a refusal."""

from hypothesis import given, settings
from hypothesis import strategies as st

from karma.agent.seeing.perceive import truth_of
from karma.bench.methods.expert import ExpertEpisode
from karma.bench.methods.expert_choices import Chooser, Lessons, Surroundings, left
from karma.goals.goals import GoalTracker, parse_goal
from karma.household.places import NEAR_M
from karma.types.events import Outcome
from karma.types.space import SceneRef
from karma.types.tasks import SubTask
from karma.world.sim import EmbeddedWorld


def ids(world, kind):
    return [one.object_id for one in truth_of(world.last_event).objects if one.object_type == kind]


def done(world, *goals):
    """Let the expert meet goals; returns its lines, and the results that were refusals."""
    subtask = SubTask(instruction="do it", whole="do it", goals=tuple(map(parse_goal, goals)))
    tracker = GoalTracker()
    expert = ExpertEpisode(world, SceneRef(name="here"))
    moments = list(expert.do(subtask))
    assert isinstance(moments[-1], Outcome)
    assert moments[-1].finished, [str(one.call) + one.reason for one in moments[:-1]]
    tracker.start(world.last_event)
    results = moments[:-1]
    return [str(result.call) for result in results], [one for one in results if not one.ok]


# ----------------------------------------------------------------- names and counts


def test_expert_puts_two_of_a_kind_into_one_place():
    world = EmbeddedWorld("kitchen_1")
    done(world, "2*ON(Egg, DiningTable)")
    world.reset("bedroom_1")
    done(world, "2*INSIDE(Book, Drawer)", "CLOSED(Drawer)")


def test_expert_takes_the_thing_for_which_least_is_left_to_do():
    world = EmbeddedWorld("kitchen_1")
    in_fridge = next(one for one in ids(world, "Egg") if "Fridge" in parents(world, one))
    said, _ = done(world, "STATE(Egg, cleaned)", "INSIDE(Egg, Fridge)")
    assert any(in_fridge in line for line in said)
    world.reset("bedroom_1")
    book = ids(world, "Book")[0]
    assert done(world, "ON(Book, Desk)")[0] == [], book


def parents(world, object_id):
    return {place.split("|")[0] for place in on(world, object_id)}


def on(world, object_id):
    things = truth_of(world.last_event).objects
    return set(next(t for t in things if t.object_id == object_id).parent_ids)


def test_expert_is_not_led_astray_by_another_thing_that_meets_part_of_the_goals():
    """Two potatoes: one lies in the fridge, the other is to be had hot and end there."""
    world = EmbeddedWorld("kitchen_2")
    said, refused = done(world, "STATE(Potato, heated)", "INSIDE(Potato, Fridge)")
    assert refused == []
    assert len({line for line in said if line.startswith("PickupObject")}) == 1


# ----------------------------------------------------------------- shut in, full, hidden


def test_expert_slices_what_is_in_a_closed_cabinet():
    world = EmbeddedWorld("kitchen_1")
    done(world, "INSIDE(Apple, Cabinet)", "CLOSED(Cabinet)")
    _, refused = done(world, "STATE(Apple, sliced)")
    assert refused == []


def test_expert_empties_vessels_of_water_and_of_things():
    world = EmbeddedWorld("kitchen_1")
    done(world, "STATE(Mug, filled)")
    said, _ = done(world, "STATE(Mug, empty)", "ON(Mug, DiningTable)")
    world.reset("kitchen_1")
    done(world, "ON(Apple, Bowl)")
    said, _ = done(world, "STATE(Bowl, empty)", "INSIDE(Bowl, Sink)")
    assert not any(line.startswith("EmptyObject") for line in said)


def test_expert_makes_room_where_the_only_place_is_taken():
    world = EmbeddedWorld("kitchen_1")
    first, second = ids(world, "Mug")
    done(world, f"ON({first}, CoffeeMachine)")
    said, refused = done(world, f"ON({second}, CoffeeMachine)")
    assert len(refused) == 1
    assert any(line.startswith("PickupObject") and first in line for line in said)


def test_expert_gives_up_what_nobody_can_do():
    world = EmbeddedWorld("kitchen_1")
    subtask = SubTask(instruction="no", whole="no", goals=(parse_goal("ON(Sofa, Mug)"),))
    (outcome,) = ExpertEpisode(world, SceneRef(name="kitchen_1")).do(subtask)
    assert not outcome.finished


# ----------------------------------------------------------------- near


def test_expert_puts_a_thing_near_a_place_in_metres():
    world = EmbeddedWorld("kitchen_1")
    bread = next(t for t in truth_of(world.last_event).objects if t.object_type == "Bread")
    x, y, z = bread.position_m
    done(world, f"ON(Apple, ({x}, {y}, {z}))")
    apple = next(t for t in truth_of(world.last_event).objects if t.object_type == "Apple")
    assert sum((a - b) ** 2 for a, b in zip(apple.position_m, (x, y, z), strict=True)) < NEAR_M**2


# ----------------------------------------------------------------- choosing, whatever is asked

MOVABLE = ("Apple", "Egg", "Mug", "Bowl", "Plate", "Potato", "Spoon", "Sofa")
PLACES = ("Fridge", "Bowl", "Plate", "DiningTable", "Cabinet", "Sink", "CounterTop")
ASKED = st.one_of(
    st.tuples(st.sampled_from(MOVABLE), st.sampled_from(PLACES)).map("ON({0[0]}, {0[1]})".format),
    st.tuples(st.sampled_from(MOVABLE), st.sampled_from(("clean", "sliced", "cold"))).map(
        "STATE({0[0]}, {0[1]})".format
    ),
    st.sampled_from(MOVABLE).map("HOLDON(robot, {})".format),
    st.sampled_from(("OPEN(Fridge)", "TOGGLEON(Microwave)", "CLOSED(Cabinet)")),
)


@settings(max_examples=40)
@given(texts=st.lists(ASKED, min_size=1, max_size=4, unique=True))
def test_chooser_leaves_no_more_to_do_than_the_judge_misses(texts):
    event = EVENT
    goals = [parse_goal(text) for text in texts]
    tracker = GoalTracker()
    tracker.start(event)
    around = Surroundings(truth_of(event), ())
    chooser = Chooser(tracker.meanings(event), around.rank, around.shut_in, Lessons())
    bound = chooser.bound(goals)
    there = [goal for goal in goals if "Sofa" not in goal.arguments]
    assert len(bound) == len(there)
    assert sum(not holds for _, holds in bound) == len(tracker.unmet(there, event))
    assert {goal for goal, holds in bound if not holds} <= set(left(bound))
    meant = [
        pair
        for goal, (one, _) in zip(there, bound, strict=True)
        for pair in zip(goal.arguments, one.arguments, strict=True)
    ]
    assert len(dict(meant)) == len(set(meant))  # a name stands for one object


EVENT = EmbeddedWorld("kitchen_1").last_event
