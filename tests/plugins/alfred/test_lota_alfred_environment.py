"""LoTa-Bench's skills, what they do otherwise than EB-ALFRED's actions, and how an episode ends."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support import alfred_kitchen as ours
from support import eb_alfred as eb
from support.lota_alfred import environment
from support.paths import SHARED

from karma.plugins.alfred.eb_world.actions import LOTA_ALFRED, read_types, skills_of

FETCH = ("find an apple", "pick up the apple")
FAR_APPLE = ours.pose("Apple_2", (1.4, 0.81, 0.1))


# ----------------------------------------------------------------- the list


def test_skills_are_written_in_natural_words():
    names = [str(skill) for skill in skills_of(eb.TYPES)]
    assert names[:5] == ["done", "find an apple", "find an egg", "find a knife", "find a fridge"]
    assert names[8:10] == ["pick up the apple", "put down the apple"]
    assert names[-3:] == ["slice the apple", "turn on the faucet", "turn off the faucet"]
    assert {"open the fridge", "close the drawer", "find a dining table"} < set(names)


@pytest.mark.shared
def test_skills_of_the_benchmarks_types_are_the_214():
    path = SHARED / "data/eb_alfred/action_types.json"
    skills = skills_of(read_types(path))
    counts = {
        verb: sum(one.verb == verb for one in skills)
        for verb in ("done", "find", "pick up", "put", "open", "close", "slice", "turn on")
    }
    assert list(counts.values()) == [1, 80, 53, 53, 7, 7, 5, 4]
    names = {str(skill) for skill in skills}
    assert len(names) == len(skills) == 214
    assert {"find an arm chair", "find an ottoman", "find a CD", "put down the CD"} < names


# ----------------------------------------------------------------- what they do


def test_find_stays_where_the_thing_is_in_view_and_near(tmp_path):
    env = environment(tmp_path)
    assert eb.say(env, "find an apple").ok
    there = env.world.state.pose
    assert eb.say(env, "find a dining table", "find an apple").ok
    assert env.world.state.pose == there
    assert eb.say(env, "find a fridge").ok
    assert env.world.state.pose != there


def test_find_goes_to_the_nearest_of_a_type(tmp_path):
    env = environment(tmp_path, more=(FAR_APPLE,))
    eb.say(env, "find an egg", "find a knife", *FETCH)
    assert env.held == ours.APPLE
    assert "find a stove burner 2" not in map(str, env.actions)


def test_put_down_that_fails_lets_go_at_once(tmp_path):
    env = environment(tmp_path)
    step = eb.say(env, *FETCH, "find a fridge", "put down the apple")  # it is shut
    assert "dropped" in step.feedback
    assert not step.ok
    assert env.held is None


def test_put_down_without_a_place_drops_and_counts_as_failed(tmp_path):
    env = environment(tmp_path)
    step = eb.say(env, *FETCH, "put down the apple")
    assert (step.ok, env.held) == (False, None)
    assert "holds nothing" in eb.say(env, "put down the apple").feedback


# ----------------------------------------------------------------- how it ends


def test_episode_goes_on_when_the_goal_is_met_and_may_undo_it(tmp_path):
    env = environment(tmp_path)
    eb.say(env, *FETCH, "find a fridge", "open the fridge", "put down the apple")
    assert (env.end, env.goal_met) == ("", True)
    eb.say(env, "pick up the apple", "done")
    assert (env.end, env.goal_met) == ("done", False)


def test_episode_ends_after_25_skills_however_many_fail(tmp_path):
    env = environment(tmp_path)
    for _ in range(24):
        env.step("wave")
    assert env.end == ""
    eb.say(env, "done")
    assert (env.end, env.invalid, len(env.steps)) == ("done", 24, LOTA_ALFRED.most_steps)
    with pytest.raises(ValueError, match="has ended"):
        env.step("wave")


@settings(max_examples=15, deadline=None)
@given(numbers=st.lists(st.integers(0, 20), min_size=1, max_size=30), strict=st.booleans())
def test_episode_any_skills_end_within_the_limit(tmp_path_factory, numbers, strict):
    env = environment(tmp_path_factory.mktemp("room"), strict=strict)
    for number in numbers:
        if env.end:
            break
        env.step(number)
    names = [step.name for step in env.steps]
    assert len(names) <= LOTA_ALFRED.most_steps
    assert ("done" in names) == (env.end == "done")
    assert env.invalid == sum(not step.ok for step in env.steps)
