"""Afterwards it is said what is so: by what the agent has seen, never by how the room is."""

from dataclasses import replace

from support.household import bring
from support.talking import STORE, TAKE, WASH, agent_saying

from karma.agent.body.afterwards import checked
from karma.plugins.rules.talk.undone import taken_back
from karma.types.events import SkillResult
from karma.types.memory import Experience
from karma.types.planning import SkillCall


def told(reply):
    return [str(check) for check in reply.checks]


def test_what_was_put_away_before_the_eyes_is_seen(tmp_path):
    reply = agent_saying(tmp_path, [STORE]).do("put the apple in the fridge")
    assert told(reply) == ["the apple is in the fridge: seen"]


def test_what_was_washed_is_seen_where_it_lies_and_clean_by_the_deed(tmp_path):
    reply = agent_saying(tmp_path, [TAKE + WASH]).do("wash the apple")
    assert told(reply) == ["the apple is in the sink: seen", "the apple is clean: done, not seen"]


def test_last_deed_with_a_thing_counts(tmp_path):
    reply = agent_saying(tmp_path, [TAKE + WASH + STORE]).do(
        "wash the apple and put it in the fridge"
    )
    assert told(reply) == [
        "the apple is in the fridge: seen", "the apple is clean: done, not seen",
        "the apple: that is so already: seen",  # of the second request
    ]  # fmt: skip


def test_what_was_not_come_to_is_not_seen(tmp_path):
    program = "GoToObject(robot, 'Sofa')\n" + STORE
    reply = agent_saying(tmp_path, [program] * 9).do("put the apple in the fridge")
    assert reply.status == "unfinished"
    assert told(reply) == ["the apple is in the fridge: not seen"]


def test_truth_behind_the_agents_back_changes_nothing_that_it_says(tmp_path):
    honest, watched = (agent_saying(tmp_path / name, [STORE, TAKE]) for name in "ab")
    honest.do("put the apple in the fridge")
    said = [moment for moment in watched.doing("put the apple in the fridge")]
    world = watched._world
    world.step("OpenObject", objectId=_id(world, "Fridge"), forceAction=True)
    assert bring(world, "Apple", "DiningTable")[0]
    assert said[-1].checks == honest.replies[-1].checks


def test_sight_that_contradicts_the_deed_is_told(tmp_path):
    agent = agent_saying(tmp_path, [STORE])
    *_, part = agent.doing("put the apple in the fridge")
    calls = tuple(result.call for result in part.results)
    apple = next(name for result in part.results for name in result.object_ids if "Apple" in name)
    shown = _experience_with(agent, apple, ("CounterTop|1|2|3",))
    (check,) = checked(calls, part.results, shown)
    assert str(check) == "the apple is in the fridge: no, it is on the counter top"


def test_thing_that_was_handled_and_never_in_view_again_is_not_called_seen():
    call = SkillCall(skill="PutObject", objects=("Apple", "Fridge"))
    result = SkillResult(call=call, ok=True, object_ids=("Apple|1|2|3", "Fridge|1|2|3"))
    (check,) = checked((call,), (result,), _nothing())
    assert str(check) == "the apple is in the fridge: not seen"


def _nothing():
    return Experience(
        seen={},
        views={},
        held=None,
        handled_ids=(),
        effects={},
        missed={},
        cut=frozenset(),
    )


def _experience_with(agent, name, parents):
    """What an agent knows that last saw a thing elsewhere."""
    from karma.agent.seeing.perceive import observe

    view = observe(agent._world.last_event, touched=[name])
    sight = next(one for one in (*view.seen, *view.touched) if one.object_id == name)
    moved = replace(sight, parent_ids=parents)
    view = replace(view, seen=(moved,), touched=())
    return replace(_nothing(), seen={name: moved}, views={name: view})


def _id(world, kind):
    things = world.last_event.metadata["objects"]
    return next(thing["objectId"] for thing in things if thing["objectType"] == kind)


# ----------------------------------------------------------------- what a later request undoes

BOOK, DESK, TV = "Book|1|2|3", "Desk|1|2|3", "Television|1|2|3"


def did(skill, *objects, ok=True):
    return SkillResult(
        call=SkillCall(skill=skill, objects=objects), ok=ok, object_ids=tuple(objects)
    )


def test_what_a_later_request_took_back_unasked_is_not_so_any_more():
    earlier, later = [did("PickupObject", BOOK)], [did("PutObject", BOOK, DESK)]
    (check,) = taken_back(earlier, later, {("take", "Book")}, {("cool", "Apple")})
    assert str(check) == "the book is in the hand: no, now it is on the desk"


def test_what_a_later_request_asks_to_undo_is_meant():
    earlier, later = [did("PickupObject", BOOK)], [did("PutObject", BOOK, DESK)]
    assert not taken_back(earlier, later, {("take", "Book")}, {("put", "Book")})
    assert taken_back(earlier, later, {("take", "Book")}, {("wash", "Book")})
    switched = [did("ToggleOn", TV)], [did("ToggleOff", TV)]
    assert not taken_back(*switched, {("on", "Television")}, {("off", "Television")})
    assert taken_back(*switched, {("on", "Television")}, {("look", "Television")})


def test_failed_calls_and_things_that_nobody_asked_about_take_nothing_back():
    earlier = [did("PickupObject", BOOK)]
    assert not taken_back(
        earlier, [did("PutObject", BOOK, DESK, ok=False)], {("take", "Book")}, set()
    )
    assert not taken_back(earlier, [did("PutObject", BOOK, DESK)], {("take", "Apple")}, set())


def test_what_was_only_on_the_way_or_is_so_again_is_not_taken_back():
    sink, oven = "Sink|1|2|3", "Microwave|1|2|3"
    washed = [did("PickupObject", BOOK), did("PutObject", BOOK, sink)]
    moved = [did("PickupObject", BOOK), did("PutObject", BOOK, oven)]
    assert not taken_back(washed, moved, {("wash", "Book")}, {("heat", "Book")})
    assert taken_back(washed, moved, {("put", "Book")}, {("heat", "Book")})
    again = [did("PickupObject", BOOK), did("PutObject", BOOK, "Microwave|9|9|9")]
    assert not taken_back(moved, again, {("put", "Book")}, {("heat", "Book")})
