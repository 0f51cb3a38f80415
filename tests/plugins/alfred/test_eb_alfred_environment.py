"""EB-ALFRED's actions, limits and score, over a kitchen made by hand."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support import alfred_kitchen as ours
from support import eb_alfred as eb

from karma.plugins.alfred.eb_world.actions import DROP, EB_ALFRED, PUT
from karma.plugins.alfred.suites.players import ChancePlayer, ExpertPlayer

SECOND_APPLE = "Apple|+01.40|+00.81|+00.10"
TWO_APPLES = (ours.pose("Apple_2", (1.4, 0.81, 0.1), objectId=SECOND_APPLE),)


# ----------------------------------------------------------------- the list


def test_actions_begin_with_those_of_every_room_in_the_order_of_the_types(tmp_path):
    names = [str(action) for action in eb.environment(tmp_path).actions]
    assert names[:7] == [f"find a {kind}" for kind in eb.TYPES.objs]
    assert names[7:13] == [*(f"pick up the {kind}" for kind in eb.TYPES.pick_obj), PUT, DROP]
    assert names[13:17] == [
        "open the Fridge", "close the Fridge", "open the Drawer", "close the Drawer",
    ]  # fmt: skip
    assert names[17:20] == ["turn on the Faucet", "turn off the Faucet", "slice the Apple"]


def test_actions_second_instances_get_a_suffix_and_the_bare_name_is_the_first(tmp_path):
    env = eb.environment(tmp_path, more=TWO_APPLES)
    found = {str(action): action.object_id for action in env.actions}
    assert (found["find a Apple"], found["find a Apple_2"]) == (ours.APPLE, SECOND_APPLE)
    assert found["find a Fridge"] == found["pick up the Apple"] == ""
    assert "find a StoveBurner_2" in found  # a receptacle, though not among the types
    assert "pick up the Apple_2" not in found
    assert list(found).index("find a StoveBurner_2") < list(found).index("find a Apple_2")


# ----------------------------------------------------------------- what they do


def test_find_goes_beside_the_object_and_turns_to_it(tmp_path):
    env = eb.environment(tmp_path)
    assert eb.say(env, "find a Apple").ok
    pose = env.world.state.pose
    assert pose.position_m[::2] == (1.0, -0.5)
    assert pose.yaw_deg == 90.0
    assert ours.APPLE in env.world.state.sight.visible


def test_pick_up_takes_the_nearest_and_says_why_it_cannot(tmp_path):
    env = eb.environment(tmp_path, more=TWO_APPLES)
    assert eb.say(env, "find a Apple_2", "pick up the Apple").ok
    assert env.held == SECOND_APPLE
    assert "already holds Apple" in eb.say(env, "find a Knife", "pick up the Knife").feedback
    assert "it is in Fridge" in eb.say(env, "pick up the Egg").feedback
    assert "holds nothing" in eb.say(env, DROP, PUT).feedback


def test_put_goes_where_the_last_find_led_and_opening_does_not_change_that(tmp_path):
    env = eb.environment(tmp_path)
    eb.say(env, "find a Apple", "pick up the Apple", "find a Fridge")
    shut = eb.say(env, PUT)
    assert "putting it at the Fridge failed" in shut.feedback
    assert env.held == ours.APPLE
    assert eb.say(env, "open the Fridge", PUT).ok
    assert env.end == "goal met"


def test_put_that_fails_for_the_third_time_lets_go(tmp_path):
    env = eb.environment(tmp_path)
    eb.say(env, "find a Apple", "pick up the Apple", "find a Fridge", PUT)
    assert "dropped" not in eb.say(env, "find a Fridge", PUT).feedback
    assert "dropped instead" in eb.say(env, "find a Fridge", PUT).feedback
    assert env.held is None


def test_put_counts_outlive_episodes_only_where_they_are_handed_on(tmp_path):
    puts = {"Fridge": 2}
    env = eb.environment(tmp_path, puts=puts, strict=True)
    step = eb.say(env, "find a Apple", "pick up the Apple", "find a Fridge", PUT)
    assert "dropped instead" in step.feedback
    assert puts == {"Fridge": 3}


def test_put_that_fails_leaves_the_pose_only_when_strict(tmp_path):
    poses = []
    for strict in (False, True):
        env = eb.environment(tmp_path, strict=strict)
        eb.say(env, "find a Apple", "pick up the Apple", "find a Fridge")
        before = env.world.state.pose
        eb.say(env, PUT)
        poses.append(env.world.state.pose == before)
    assert poses == [True, False]


def test_open_what_is_open_and_close_what_is_closed_are_invalid(tmp_path):
    env = eb.environment(tmp_path)
    assert "already closed" in eb.say(env, "find a Fridge", "close the Fridge").feedback
    assert "already open" in eb.say(env, "open the Fridge", "open the Fridge").feedback


def test_slice_needs_no_knife_and_pieces_are_picked_up_as_the_whole(tmp_path):
    env = eb.environment(tmp_path)
    assert eb.say(env, "find a Apple", "slice the Apple", "pick up the Apple").ok
    assert "AppleSliced" in env.held


# ----------------------------------------------------------------- ends and scores


def test_episode_ends_after_the_last_step(tmp_path):
    env = eb.environment(tmp_path)
    eb.say(env, *["find a Fridge"] * EB_ALFRED.most_steps)
    assert env.end == "steps"
    with pytest.raises(ValueError, match="has ended"):
        env.step(0)


def test_episode_ends_with_the_tenth_invalid_action_unusable_answers_counted(tmp_path):
    env = eb.environment(tmp_path)
    eb.say(env, *["find a Pen"] * (EB_ALFRED.most_invalid - 1))
    env.count_unusable()
    assert env.end == "invalid actions"
    assert len(env.steps) == EB_ALFRED.most_invalid - 1


def test_expert_reaches_the_goal_of_our_demonstration(tmp_path):
    env = eb.played(ExpertPlayer(), eb.environment(tmp_path))
    assert env.end == "goal met"
    assert [step.name for step in env.steps] == [
        "find a Apple", "pick up the Apple", "find a Fridge", "open the Fridge", PUT,
    ]  # fmt: skip


def test_chance_is_the_same_for_the_same_episode_and_another_for_another(tmp_path):
    def names(use):
        env = eb.played(ChancePlayer(0, use), eb.environment(tmp_path))
        return [step.name for step in env.steps]

    assert names("base/0") == names("base/0")
    assert names("base/0") != names("base/1")


@settings(max_examples=15, deadline=None)
@given(numbers=st.lists(st.integers(0, 19), min_size=1, max_size=40), strict=st.booleans())
def test_episode_any_actions_end_within_the_limits(tmp_path_factory, numbers, strict):
    env = eb.environment(tmp_path_factory.mktemp("room"), strict=strict)
    for number in numbers:
        if env.end:
            break
        env.step(number)
    assert len(env.steps) <= EB_ALFRED.most_steps
    assert env.invalid == sum(not step.ok for step in env.steps) <= EB_ALFRED.most_invalid
    met = env.conditions
    assert (met.met == met.of) == (env.end == "goal met")
