"""ALFRED's trials as tasks of ours: their goals beside ALFRED's own conditions."""

import os

import msgspec
import pytest
from support.made_events import event, thing
from support.paths import SHARED

from karma.goals.goals import GoalTracker
from karma.plugins.alfred.published_tasks import goals_of
from karma.plugins.alfred.replay.facts import gather, side_files
from karma.plugins.alfred.replay.goal import Deeds, conditions, noteworthy
from karma.plugins.alfred.replay.replay import FOV_DEG, REACH_M, fitted
from karma.plugins.alfred.replay.steps import translated
from karma.plugins.alfred.replay.trial import TYPES_OF_TASK, Trial, read_trials
from karma.world.sim import EmbeddedWorld

TRIALS = SHARED / "data/alfred/valid_seen.jsonl.gz"
SAMPLE = int(os.environ.get("KARMA_SAMPLE", "12"))  # trials; of each kind of task, then of slices


def trial(kind, thing_, **targets):
    scene = {
        "floor_plan": "FloorPlan1", "object_poses": [], "object_toggles": [],
        "init_action": {"action": "TeleportFull", "x": 0, "y": 0.9, "z": 0, "horizon": 30,
                        "rotation": 0},
    }  # fmt: skip
    record = {
        "id": "t", "task_type": kind, "scene": scene,
        "pddl_params": {"object_target": thing_, **targets},
        "plan": {"high_pddl": [], "low_actions": []},
    }  # fmt: skip
    return msgspec.convert(record, Trial)


# ----------------------------------------------------------------- the goals


@pytest.mark.parametrize(
    ("kind", "targets", "meant"),
    [
        ("pick_and_place_simple", {"object_target": "Pen", "parent_target": "Desk"},
         "ON(Pen/Pencil, Desk)"),
        ("pick_two_obj_and_place", {"object_target": "CD", "parent_target": "Safe"},
         "2*ON(CD, Safe)"),
        ("pick_two_obj_and_place",
         {"object_target": "Apple", "parent_target": "Fridge", "object_sliced": True},
         "2*STATE(Apple, sliced); 2*ON(AppleSliced, Fridge)"),
        ("look_at_obj_in_light", {"object_target": "Box", "toggle_target": "DeskLamp"},
         "HOLDON(robot, Box/TissueBox); STATE(DeskLamp, shining)"),
        ("pick_clean_then_place_in_recep",
         {"object_target": "Knife", "parent_target": "SinkBasin"},
         "STATE(Knife/ButterKnife, cleaned); ON(Knife/ButterKnife, SinkBasin)"),
        ("pick_heat_then_place_in_recep", {"object_target": "Pot", "parent_target": "Toilet"},
         "STATE(Pot/Potato, heated); ON(Pot/Potato, Toilet/ToiletPaperHanger)"),
        ("pick_cool_then_place_in_recep",
         {"object_target": "Bread", "parent_target": "Cart", "object_sliced": True},
         "STATE(Bread, sliced); STATE(BreadSliced, cooled); ON(BreadSliced, Cart)"),
        ("pick_and_place_with_movable_recep",
         {"object_target": "Fork", "mrecep_target": "Cup", "parent_target": "Sink"},
         "ON(Fork, Cup); ON(Cup, Sink)"),
    ],
)  # fmt: skip
def test_goals_of_a_trial_say_what_its_kind_of_task_asks_for(kind, targets, meant):
    found = goals_of(trial(kind, targets.pop("object_target"), **targets))
    assert "; ".join(str(goal).removesuffix(": 1") for goal in found) == meant


# ----------------------------------------------------------------- beside ALFRED's conditions


def both(given, *events):
    """Return what ours and what ALFRED's rules count after events of no deed."""
    tracker = GoalTracker()
    tracker.start(events[0])
    for later in events[1:]:
        tracker.update(later)
    ours = tracker.progress(goals_of(given), events[-1])
    return tuple(ours), tuple(conditions(given, events[-1].metadata, Deeds(agreeing=False)))


DESK, OTHER = (thing(f"Desk|{i}", receptacle=True) for i in (1, 2))


def pencil(number, *inside, **fields):
    return thing(f"Pencil|{number}", inside=inside, pickupable=True, **fields)


@pytest.mark.parametrize("inside", [((), ()), (("Desk|1",), ()), (("Desk|1",), ("Desk|2",)),
                                    (("Desk|1",), ("Desk|1",))])  # fmt: skip
def test_two_of_a_kind_are_counted_as_by_alfred(inside):
    given = trial("pick_two_obj_and_place", "Pen", parent_target="Desk")
    now = event(DESK, OTHER, *(pencil(i, *where) for i, where in enumerate(inside)))
    ours, alfreds = both(given, now)
    assert ours == alfreds


@pytest.mark.parametrize("held", [(), ("Pencil|1",)])
@pytest.mark.parametrize(("on", "visible"), [(True, True), (True, False), (False, True)])
def test_look_in_the_light_is_counted_as_by_alfred(held, on, visible):
    given = trial("look_at_obj_in_light", "Pencil", toggle_target="DeskLamp")
    lamp = thing("DeskLamp|1", toggleable=True, isToggled=on, visible=visible)
    ours, alfreds = both(given, event(lamp, pencil(1), held=held))
    assert ours == alfreds


def test_stack_is_counted_as_by_alfred_also_when_its_parts_are_apart():
    given = trial(
        "pick_and_place_with_movable_recep", "Pencil", mrecep_target="Mug", parent_target="Desk"
    )
    for pencil_in, mugs_in in [((), ("", "")), (("Mug|1",), ("", "Desk|1")),
                               (("Mug|1",), ("Desk|2", "Desk|1"))]:  # fmt: skip
        mugs = [
            thing(f"Mug|{i}", inside=[at] if at else (), receptacle=True, pickupable=True)
            for i, at in enumerate(mugs_in, start=1)
        ]
        ours, alfreds = both(given, event(DESK, OTHER, *mugs, pencil(1, *pencil_in)))
        assert ours == alfreds


# ----------------------------------------------------------------- on demonstrations


def disagreements(given, facts):
    """Replay a demonstration; return the events at which the counts differ, and how many ended."""
    world = EmbeddedWorld(fitted(given, facts), visibilityDistance=REACH_M, fieldOfView=FOV_DEG)
    tracker, deeds, goals = GoalTracker(), Deeds(agreeing=False), goals_of(given)
    tracker.start(world.last_event)
    found, events = [], 0
    for number, low in enumerate([None, *given.plan.low_actions]):
        if low is not None:
            name, arguments = translated(
                low.api_action, held=world.state.held, present=world.state.objects
            )
            done = world.step(name, **arguments)
            if not done.success and "objectId" in arguments:
                done = world.step(name, **{**arguments, "forceAction": True})
            tracker.update(done)
            target = str(arguments.get("objectId", ""))
            if done.success and noteworthy(name, target):
                deeds.note(name, target, done.metadata)
        events += 1
        last = world.last_event
        ours = tracker.progress(goals, last)
        alfreds = conditions(given, last.metadata, deeds)
        assert (not tracker.unmet(goals, last)) is (ours.met == ours.of)
        if tuple(ours) != tuple(alfreds):
            found.append((number, tuple(ours), tuple(alfreds)))
    return found, events, ours.met == ours.of


def sample(trials):
    """Return the trials of the shortest demonstrations: of each kind, of slices, then others."""
    short = sorted(trials, key=lambda one: (len(one.plan.low_actions), one.id))
    first = {one.task_type: one for one in reversed(short)}
    cut = [one for one in short if one.pddl_params.object_sliced]
    order = {one.id: one for one in (*(first[kind] for kind in TYPES_OF_TASK), *cut, *short)}
    return list(order.values())[:SAMPLE]


@pytest.mark.shared
def test_goals_agree_with_alfreds_conditions_on_every_event_of_demonstrations():
    trials = sample(list(read_trials(TRIALS)))
    facts = gather(trials, side_files())
    for one in trials:
        found, _, done = disagreements(one, facts[one.scene.floor_plan])
        assert (one.id, found, done) == (one.id, [], True)
