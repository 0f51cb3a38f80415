"""Goals: what they mean on hand-made events, and on the embedded world."""

import pytest
from support.made_events import event, goals, thing, unmet

from karma import registry
from karma.errors import KarmaError
from karma.goals.goals import MOST, GoalTracker, object_names, parse_goal, read_goal
from karma.types.tasks import SubTask
from karma.world.core import scene as scenes

BASIN = "Sink|1|SinkBasin"


def sink(*, running=False):
    return (
        thing("Sink|1", receptacle=False),
        thing(BASIN, objectType="SinkBasin", receptacle=True),
        thing("Faucet|1", toggleable=True, isToggled=running),
    )


# ----------------------------------------------------------------- reading


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("ON(Apple, Plate): 1", "ON(Apple, Plate): 1"),
        (" inside ( Apple ,Fridge ) :1 ", "INSIDE(Apple, Fridge): 1"),
        ("SWITCHON(DeskLamp)", "TOGGLEON(DeskLamp): 1"),
        ("State(Apple, Washed): 1", "STATE(Apple, cleaned): 1"),
        ("STATE(Apple, warm)", "STATE(Apple, hot): 1"),
        ("HOLDON(robot, Pan)", "HOLDON(robot, Pan): 1"),
        ("CLOSED(Fridge)", "CLOSED(Fridge): 1"),
        ("ON(Cup, (-1.5, 0.8, 0.3))", "ON(Cup, (-1.5, 0.8, 0.3)): 1"),
        ("2*ON(Pen, Desk)", "2*ON(Pen, Desk): 1"),
        (" 3 * in(Apple,Fridge) : 1", "3*INSIDE(Apple, Fridge): 1"),
        ("1*OPEN(Drawer)", "OPEN(Drawer): 1"),
        ("2*STATE(Cup/Mug, open)", "2*STATE(Cup/Mug, opened): 1"),
        ("2*ON(Cup, (1, 2, 3))", "2*ON(Cup, (1, 2, 3)): 1"),
    ],
)
def test_parse_goal_in_the_papers_notation_is_canonical(text, meant):
    assert str(parse_goal(text)) == meant
    assert parse_goal(meant) == parse_goal(text)


@pytest.mark.parametrize(
    "text",
    ["", "apple on plate", "ON(Apple)", "ON(Apple, )", "NEAR(Apple, Cup)", "STATE(Book, sofa)",
     "HOLDON(Pan, robot)", "ON(Apple, Plate): 0", "TOGGLEON(Faucet, Sink)", "0*ON(Pen, Desk)",
     "-1*ON(Pen, Desk)", "1.5*ON(Pen, Desk)", "*ON(Pen, Desk)", "ON(Pen, Desk)*2",
     "2 ON(Pen, Desk)", f"{MOST + 1}*ON(Pen, Desk)", "ON(2*Pen, Desk)*",
     f"{10**40}*ON(Pen, Desk)", "2*HOLDON(robot, Pen)", "²*ON(Pen, Desk)"],
)  # fmt: skip
def test_parse_goal_of_another_form_is_refused(text):
    with pytest.raises(KarmaError, match="goal"):
        parse_goal(text)


def test_object_names_leave_out_robot_states_and_positions():
    assert object_names(parse_goal("HOLDON(robot, Pan)")) == ("Pan",)
    assert object_names(parse_goal("STATE(Pan, hot)")) == ("Pan",)
    assert object_names(read_goal("ON(Pan, (1, 2, 3))")) == ("Pan",)
    assert object_names(parse_goal("ON(Egg, Pan)")) == ("Egg", "Pan")


# ----------------------------------------------------------------- placements


def test_placement_counts_through_carried_receptacles_but_not_through_furniture():
    things = [
        thing("Apple|1", inside=["Bowl|1"], pickupable=True),
        thing("Bowl|1", inside=["Fridge|1"], pickupable=True, receptacle=True),
        thing("Fridge|1", inside=["Floor|1"], receptacle=True),
        thing("Floor|1", receptacle=True),
    ]
    now = event(*things)
    assert unmet(now, "INSIDE(Apple, Bowl)", "INSIDE(Apple, Fridge)", "ON(Bowl, Fridge)") == []
    assert unmet(now, "ON(Apple, Floor)") == ["ON(Apple, Floor): 1"]


def test_sink_means_its_basin_and_types_are_exact():
    now = event(*sink(), thing("Pencil|1", inside=[BASIN], pickupable=True))
    assert unmet(now, "INSIDE(Pencil, Sink)", "INSIDE(Pencil, SinkBasin)") == []
    assert unmet(now, "INSIDE(Pen, Sink)") == ["INSIDE(Pen, Sink): 1"]


def test_goal_naming_an_id_means_that_object():
    now = event(thing("Mug|1", isFilledWithLiquid=True), thing("Mug|2"))
    assert unmet(now, "STATE(Mug, filled)", "STATE(Mug|1, filled)") == []
    assert unmet(now, "STATE(Mug|2, filled)") == ["STATE(Mug|2, filled): 1"]


def test_alternatives_accept_any_of_the_types():
    now = event(thing("Cup|1", inside=["Desk|1"]), thing("Desk|1", receptacle=True))
    assert unmet(now, "ON(Mug/Cup, DiningTable/Desk)") == []
    assert unmet(now, "ON(Mug/Cup, DiningTable/Shelf)") != []


def test_position_goals_and_goals_beside_things_are_met_within_half_a_metre():
    near = thing("SoapBar|1", position={"x": 1.2, "y": 1.0, "z": 0.0}, pickupable=True)
    cloth = thing("Cloth|1", position={"x": 1.0, "y": 1.0, "z": 0.3})
    texts = ("ON(SoapBar, (1.0, 1.0, 0.3))", "ON(SoapBar, Cloth)")
    assert unmet(event(near, cloth), *texts) == []
    assert len(unmet(event(near, cloth, held=["SoapBar|1"]), *texts)) == 2
    far = {**near, "position": {"x": 2.0, "y": 1.0, "z": 0.0}}
    assert len(unmet(event(far, cloth), *texts)) == 2


# ----------------------------------------------------------------- slices


def cut_apple(**fields):
    whole = thing("Apple|1", isSliced=True, inside=["Plate|1"], pickupable=True)
    slices = [
        thing(f"Apple|1|AppleSliced_{i}", objectType="AppleSliced", pickupable=True, **fields)
        for i in range(2)
    ]
    return [whole, *slices, thing("Plate|1", receptacle=True, pickupable=True)]


def test_slices_stand_for_their_whole_and_the_whole_no_longer_does():
    things = cut_apple()
    assert unmet(event(*things), "STATE(Apple, sliced)") == []
    assert unmet(event(*things), "ON(Apple, Plate)") == ["ON(Apple, Plate): 1"]
    things[2]["parentReceptacles"] = ["Plate|1"]
    texts = ("ON(Apple, Plate)", "STATE(Apple, sliced)", "ON(AppleSliced, Plate)")
    assert unmet(event(*things), *texts) == []


def test_slices_inherit_that_their_whole_was_washed():
    apple = thing("Apple|1", inside=[BASIN], pickupable=True)
    before = [event(*sink(), apple), event(*sink(running=True), apple, action="ToggleObjectOn")]
    now = event(*sink(), *cut_apple())
    assert unmet(now, "STATE(Apple, clean)", "STATE(Apple, sliced)", before=before) == []
    assert unmet(now, "STATE(Apple, cleaned)") == ["STATE(Apple, cleaned): 1"]


def test_cracked_egg_counts_as_the_egg():
    now = event(
        thing("Egg|1", isBroken=True),
        thing("Egg|1|EggCracked_0", objectType="EggCracked", isCooked=True),
    )
    assert unmet(now, "STATE(Egg, cooked)", "STATE(Egg, broken)", "STATE(Egg, sliced)") == []


# ----------------------------------------------------------------- history


def test_food_is_clean_only_after_it_lay_under_running_water():
    apple = thing("Apple|1", inside=[BASIN], pickupable=True)
    other = thing("Apple|2", pickupable=True)
    wet = event(*sink(running=True), apple, other, action="ToggleObjectOn")
    assert unmet(event(*sink(), apple, other), "STATE(Apple, clean)") != []
    away = event(*sink(), {**apple, "parentReceptacles": None}, other)
    assert unmet(away, "STATE(Apple|1, clean)", before=[wet]) == []
    assert unmet(away, "STATE(Apple|2, clean)", before=[wet]) != []


def test_dirtyable_object_is_clean_when_it_is_not_dirty():
    assert unmet(event(thing("Plate|1", dirtyable=True)), "STATE(Plate, clean)") == []
    dirty = event(thing("Plate|1", dirtyable=True, isDirty=True))
    assert unmet(dirty, "STATE(Plate, clean)") == ["STATE(Plate, clean): 1"]
    assert unmet(dirty, "STATE(Plate, dirty)") == []


def test_heated_is_for_ever_and_hot_until_it_is_cooled():
    hot = event(thing("Potato|1", temperature="Hot"))
    warm = event(thing("Potato|1"))
    cold = event(thing("Potato|1", temperature="Cold"))
    assert unmet(warm, "STATE(Potato, heated)", "STATE(Potato, hot)", before=[hot]) == []
    both = ("STATE(Potato, heated)", "STATE(Potato, cooled)")
    assert unmet(warm, *both, "STATE(Potato, cold)", before=[hot, cold]) == []
    assert unmet(warm, *both, "STATE(Potato, hot)", before=[cold, hot]) == []
    assert unmet(warm, "STATE(Potato, hot)", before=[hot, cold]) != []
    assert unmet(warm, "STATE(Potato, cold)", before=[cold, hot]) != []


def fridge(*, opened):
    return thing("Fridge|1", receptacle=True, openable=True, isOpen=opened)


def test_closed_fridge_cools_what_is_in_it():
    inside = thing("Tomato|1", inside=["Fridge|1"])
    shut = event(fridge(opened=False), inside, action="CloseObject")
    texts = ("STATE(Tomato, cooled)", "STATE(Tomato, cold)")
    assert unmet(event(fridge(opened=False), thing("Tomato|1")), *texts, before=[shut]) == []


def test_open_fridge_makes_cold_but_only_shutting_it_is_the_deed():
    inside = thing("Tomato|1", inside=["Fridge|1"], temperature="Cold")
    before = [event(fridge(opened=True), thing("Tomato|1"))]
    now = event(fridge(opened=True), inside, action="PutObject")
    assert unmet(now, "STATE(Tomato, cold)", before=before) == []
    assert unmet(now, "STATE(Tomato, cooled)", before=before) != []
    shut = event(fridge(opened=False), inside, action="CloseObject")
    assert unmet(shut, "STATE(Tomato, cooled)", before=[*before, now]) == []


def test_goal_that_names_slices_wants_the_deed_done_to_one_of_them():
    whole = thing("Apple|1", pickupable=True)
    before = [event({**whole, "temperature": "Hot"}), event(whole)]
    cut = cut_apple()
    assert unmet(event(*cut), "STATE(Apple, heated)", before=before) == []
    assert unmet(event(*cut), "STATE(AppleSliced/Apple, heated)", before=before) == []
    assert unmet(event(*cut), "STATE(AppleSliced, heated)", before=before) != []
    cut[1]["temperature"] = "Hot"
    assert unmet(event(*cut), "STATE(AppleSliced, heated)", before=before) == []


def test_appliance_must_run_during_the_subtask_and_a_lamp_at_its_end():
    tracker = GoalTracker()
    off = event(thing("Faucet|1"), thing("DeskLamp|1", toggleable=True))
    on = event(thing("Faucet|1", isToggled=True), thing("DeskLamp|1", isToggled=True))
    faucet, lamp = goals("TOGGLEON(Faucet)", "TOGGLEON(DeskLamp)")
    tracker.start(off)
    assert tracker.unmet((faucet, lamp), off) == (faucet, lamp)
    tracker.update(on)
    assert tracker.unmet((faucet, lamp), on) == ()
    tracker.update(off)
    assert tracker.unmet((faucet, lamp), off) == (lamp,)
    tracker.begin_subtask(SubTask(instruction="next"), off)
    assert not tracker.holds(faucet, off)
    assert tracker.holds(parse_goal("TOGGLEOFF(DeskLamp)"), off)


def test_doors_only_close_where_there_are_doors():
    now = event(thing("Fridge|1", openable=True), thing("Shelf|1"))
    assert unmet(now, "CLOSED(Fridge)", "STATE(Fridge, closed)") == []
    assert unmet(now, "CLOSED(Shelf)", "OPEN(Fridge)") == ["CLOSED(Shelf): 1", "OPEN(Fridge): 1"]


# ----------------------------------------------------------------- the embedded world


@pytest.fixture
def world():
    if not (scenes.SCENES / "kitchen_1.json").exists():
        pytest.skip("the scenes are not made yet")
    world = registry.load("worlds", "embedded")()
    yield world
    world.stop()


def a(last, object_type):
    return next(o["objectId"] for o in last.metadata["objects"] if o["objectType"] == object_type)


def test_tracker_on_the_embedded_world_follows_an_apple_from_sink_to_plate(world):
    tracker = GoalTracker()
    tracker.start(world.reset("kitchen_1"))

    def do(action, **arguments):
        last = world.step(action, forceAction=True, **arguments)
        assert last.metadata["lastActionSuccess"], (action, last.metadata["errorMessage"])
        tracker.update(last)
        return last

    apple, faucet = a(world.last_event, "Apple"), a(world.last_event, "Faucet")
    wash = goals("INSIDE(Apple, Sink)", "TOGGLEON(Faucet)", "STATE(Apple, clean)")
    assert not tracker.holds(wash[2], world.last_event)
    do("PickupObject", objectId=apple)
    assert tracker.holds(parse_goal(f"HOLDON(robot, {apple})"), world.last_event)
    do("PutObject", objectId=a(world.last_event, "SinkBasin"))
    assert tracker.unmet(wash, world.last_event) == wash[1:]
    do("ToggleObjectOn", objectId=faucet)
    do("ToggleObjectOff", objectId=faucet)
    assert tracker.unmet(wash, world.last_event) == ()

    tracker.begin_subtask(SubTask(instruction="next"), world.last_event)
    assert tracker.unmet(wash, world.last_event) == (wash[1],)
    do("SliceObject", objectId=apple)
    piece = a(world.last_event, "AppleSliced")
    do("PickupObject", objectId=piece)
    do("PutObject", objectId=a(world.last_event, "Plate"))
    serve = goals("ON(Apple, Plate)", "STATE(Apple, clean)", "STATE(Apple, sliced)")
    assert tracker.unmet(serve, world.last_event) == ()
