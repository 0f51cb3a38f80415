"""Which clause a goal falls due in: properties, and tasks of our own in the authors' manner."""

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from karma.tasks.authors import read_goals
from karma.tasks.clauses import clauses_of, read_clauses
from karma.tasks.loose_names import words_of
from karma.tasks.splitting import assign, unasked

# Instruction; then its goals, each behind the number of the clause it is due in.
TASKS = [
    ("Rinse the mug and dry it, pour coffee into the mug, leave it on the side table.",
     "0 STATE(mug, clean), 1 STATE(mug, filled), 2 ON(mug, side table)"),
    ("Pour the water out of the kettle, put the kettle back on the stove",
     "0 STATE(kettle, empty), 1 ON(kettle, stove)"),
    ("Fill a pot with water, boil the potato in it, then drain the pot in the sink.",
     "0 STATE(pot, filled), 1 INSIDE(potato, pot), 1 STATE(potato, cooked), 2 STATE(pot, empty)"),
    ("Chill the wine, bring it to the dining table, set two glasses next to the bottle",
     "0 STATE(wine, cooled), 1 ON(wine, dining table), 2 ON(glasses, table)"),
    ("Fry an egg, toast the bread, serve both on a plate",
     "0 STATE(egg, cooked), 1 STATE(bread, cooked), 2 ON(egg, plate), 2 ON(bread, plate)"),
    ("Fry an egg, toast the bread, serve both on a plate",
     "0 INSIDE(egg, pan), 0 TOGGLEON(stove), 1 INSIDE(bread, toaster), 1 TOGGLEON(toaster)"),
    ("Scrub the bathtub cloth, hang the towel up, flush, light the candle",
     "0 STATE(cloth, clean), 1 ON(towel, towel holder), 3 TOGGLEON(candle)"),
    ("Open the laptop, read for a while, shut it",
     "0 OPEN(laptop), 2 CLOSED(laptop)"),
    ("Switch on the floor lamp, fetch the book, switch the lamp off again",
     "0 TOGGLEON(floor lamp), 1 HOLDON(robot, book), 2 TOGGLEOFF(floor lamp)"),
    ("Tuck the pillow under the bed cover, toss the newspaper, dim the light",
     "0 ON(pillow, bed), 1 INSIDE(newspaper, bin)"),
    ("Refrigerate the lettuce, microwave a potato, dispose of the egg",
     "0 INSIDE(lettuce, fridge), 1 INSIDE(potato, microwave), 1 STATE(potato, hot), "
     "2 INSIDE(egg, garbage)"),
    ("Throw away the tomato, throw the pillow on the sofa",
     "0 INSIDE(tomato, trash can), 1 ON(pillow, sofa)"),
    ("Take the statue from the shelf to the desk, take the vase from the desk to the shelf",
     "0 ON(statue, desk), 1 ON(vase, shelf)"),
    ("Grab a knife, mince the lettuce, and then stow the knife in a drawer",
     "0 HOLDON(robot, knife), 1 STATE(lettuce, sliced), 2 INSIDE(knife, drawer)"),
    ("Wash the fork, put it in the drawer, wash the spoon, put it in the drawer",
     "0 STATE(fork, clean), 2 STATE(spoon, clean), 1 INSIDE(fork, drawer), "
     "3 INSIDE(spoon, drawer)"),
    ("Wash the fork, put it in the drawer, wash the spoon, put it in the drawer",
     "0 STATE(fork, clean), 1 INSIDE(fork, drawer), 2 STATE(spoon, clean), "
     "3 INSIDE(spoon, drawer)"),
    ("Put the keys on the dresser, put the watch beside the keys, put the phone near the watch",
     "0 ON(keys, dresser), 1 ON(watch, keys), 2 ON(phone, watch)"),
    ("Set a pan on one burner, put the kettle on another burner, turn both burners on",
     "0 ON(pan, burner), 1 ON(kettle, burner), 2 TOGGLEON(burner)"),
    ("Crack the egg in the pan, warm it up, then plate the food",
     "0 STATE(egg, broken), 0 INSIDE(egg, pan), 1 STATE(egg, cooked), 2 ON(egg, plate)"),
    ("Find the red fruit, halve it, put a piece in the bowl, cool the rest down",
     "1 STATE(apple, sliced), 2 INSIDE(apple, bowl), 3 STATE(apple, cooled)"),
    ("Could you tidy the desk: stow the pen in the drawer, shelve the book?",
     "0 INSIDE(pen, drawer), 1 ON(book, shelf)"),
    ("Please make sure the fridge is closed, turn out the lights",
     "0 CLOSED(fridge), 1 TOGGLEOFF(light)"),
    ("Brew some coffee, carry the mug to the coffee table, watch tv",
     "0 TOGGLEON(coffee machine), 0 INSIDE(mug, coffee machine), 1 ON(mug, coffee table), "
     "2 TOGGLEON(tv)"),
    ("First wipe the mirror. Next, put the soap bar on the counter; finally open the blinds!",
     "0 STATE(mirror, clean), 1 ON(soap bar, counter), 2 OPEN(blinds)"),
    ("Put the remote on the sofa, move it to the tv stand, drop it in the box",
     "0 ON(remote, sofa), 1 ON(remote, tv stand), 2 INSIDE(remote, box)"),
    ("Slice the loaf and heat a slice, arrange the slices on the plate, store the plate",
     "0 STATE(bread, sliced), 0 STATE(bread, heated), 1 ON(bread, plate), "
     "2 INSIDE(plate, cabinet)"),
    ("Gather the silverware in a bowl, rinse the bowl, set it on the island",
     "0 INSIDE(spoon, bowl), 0 INSIDE(fork, bowl), 1 STATE(bowl, clean), 2 ON(bowl, island)"),
    ("Use the lamp to examine the statue, turn the lamp off",
     "0 TOGGLEON(lamp), 0 HOLDON(robot, statue), 1 TOGGLEOFF(lamp)"),
    ("Put the apple in the fridge, slice the bread, take the apple out and put it on the counter",
     "0 INSIDE(apple, fridge), 1 STATE(bread, sliced), 2 ON(apple, counter)"),
    ("Lay the towel over the tub, rinse the sponge, leave the sponge in the basin",
     "0 ON(towel, bathtub), 1 STATE(sponge, clean), 2 INSIDE(sponge, basin)"),
    ("Put the laundry cloth in the hamper, prop the plunger by the toilet, empty the bin",
     "0 INSIDE(cloth, hamper), 1 ON(plunger, toilet)"),
    ("Water the plant with the watering can, put the can on the shelf",
     "0 STATE(plant, filled), 1 ON(watering can, shelf)"),
    ("Heat the soup pot, pour it out, wash up the pot",
     "0 ON(pot, stove), 1 STATE(pot, empty), 2 STATE(pot, clean)"),
    ("Bring me the newspaper, discard it afterwards",
     "0 HOLDON(robot, newspaper), 1 INSIDE(newspaper, garbage can)"),
    ("Box the book and the cd, bin the pencil, close the laptop",
     "0 INSIDE(book, box), 0 INSIDE(cd, box), 1 INSIDE(pencil, garbage can), 2 CLOSED(laptop)"),
    ("Put a pillow on the sofa, bring something to read to the sofa",
     "0 ON(pillow, sofa), 1 ON(newspaper, sofa)"),
    ("Set the vase on the desk, take anything nice to write with to the desk",
     "0 ON(vase, desk), 1 ON(pen, desk)"),
    ("Lay the fork on the table, put something to drink from on the table, wipe the sink",
     "0 ON(fork, table), 1 ON(cup, table), 2 STATE(sink, clean)"),
    ("Put the remote on the bed, fetch something to read, leave it on the bed",
     "0 ON(remote, bed), 1 HOLDON(robot, book), 2 ON(book, bed)"),
    ("Wash the apple, then slice the fruit and put it on the plate",
     "0 STATE(apple, clean), 1 ON(apple, plate), 1 STATE(apple, sliced)"),
    ("Find the apple and rinse it, put the mug in the sink, cut up the red fruit",
     "0 STATE(apple, clean), 1 INSIDE(mug, sink), 2 STATE(apple, sliced)"),
    ("Slice the fruit, wash the apple, heat the food, chill the potato",
     "1 STATE(apple, clean), 0 STATE(apple, sliced), 3 STATE(potato, cold), 2 STATE(potato, hot)"),
]  # fmt: skip


def numbered_goals(text):
    """Return goals and, by clause, how they are written."""
    parts = [part.split(" ", 1) for part in text.replace("), ", ")\n").split("\n")]
    wanted: dict[int, list[str]] = {}
    for number, goal in parts:
        wanted.setdefault(int(number), []).append(goal)
    goals, notes = read_goals(", ".join(goal for _, goal in parts))
    assert notes == ()
    return goals, wanted


@pytest.mark.parametrize(("instruction", "numbered"), TASKS)
def test_assign_gives_each_goal_to_the_clause_that_asks_for_it(instruction, numbered):
    goals, wanted = numbered_goals(numbered)
    clauses = clauses_of(instruction)
    found = {
        number: [str(goal).removesuffix(": 1") for goal in sub.goals]
        for number, sub in enumerate(assign(goals, clauses))
        if sub.goals
    }
    assert found == wanted, clauses


@pytest.mark.parametrize(("instruction", "numbered"), TASKS)
def test_words_ask_for_every_goal_of_our_tasks(instruction, numbered):
    assert unasked(numbered_goals(numbered)[0], clauses_of(instruction)) == ()


@pytest.mark.parametrize(
    ("instruction", "goals", "apart"),
    [
        ("Put the mug in the cabinet, wash the apple", "INSIDE(mug, fridge), STATE(apple, clean)",
         "INSIDE(mug, fridge)"),  # another place
        ("Slice the apple, throw the tomato away", "STATE(apple, sliced), INSIDE(apple, trash)",
         "INSIDE(apple, trash)"),  # another thing
        ("Wash the tomato, put the tomato in the fridge",
         "STATE(tomato, clean), STATE(tomato, sliced), INSIDE(tomato, fridge)",
         "STATE(tomato, sliced)"),  # another deed
        ("Wash the tomato, slice the bread", "STATE(tomato, sliced), STATE(bread, sliced)",
         "STATE(tomato, sliced)"),
        ("Throw the newspaper away, close the laptop", "ON(newspaper, sofa), TOGGLEON(laptop)",
         "ON(newspaper, sofa), TOGGLEON(laptop)"),
        ("Put the sliced tomato in the fridge, toast a slice", "STATE(tomato, sliced), "
         "STATE(bread, sliced), OPEN(fridge), TOGGLEON(toaster)", ""),  # said, or means
        ("Tend to the mug", "STATE(mug, clean)", ""),  # nobody knows what "tend" is
        ("Do it", "ON(vase, sofa)", ""),
    ],
)  # fmt: skip
def test_goals_of_another_thing_place_or_deed_than_the_words_are_asked_by_none(
    instruction, goals, apart
):
    found = unasked(read_goals(goals)[0], clauses_of(instruction))
    assert found == read_goals(apart)[0]


# ----------------------------------------------------------------- verbs

# What each verb asks for: a state, a place (@), a predicate (!), to bring a thing (>), or nothing.
VERBS = {
    "cleaned @Sink": "wash, clean, rinse, scrub, scour, soak, launder, cleanse, disinfect, "
    "wash up, "
    "rinse off, sanitise, bathe, clean off, hose",
    "cleaned": "wipe, dust, polish, mop, sweep, brush, wipe down, dust off, shine",
    "sliced": "slice, cut, chop, dice, mince, carve, halve, quarter, cut up, shred, julienne, "
    "divide, split, cube, chop up",
    "cooked heated @Microwave @StoveBurner": "cook, heat, warm, boil, fry, bake, roast, grill, "
    "steam, simmer, poach, reheat, heat up, warm up, melt, brown, thaw, defrost, sear, stew, "
    "broil, "
    "saute, braise, barbecue",
    "heated @Microwave": "microwave, nuke, zap",
    "cooked @Toaster": "toast",
    "cooled @Fridge": "cool, chill, refrigerate, freeze, cool down, ice",
    "filled @Faucet": "fill, refill, fill up, top up, water",
    "empty": "empty, drain, pour out, empty out, tip out, pour away, drink, dump out",
    "broken": "break, smash, shatter, crack, crush, destroy, wreck",
    "dirty": "dirty, soil, stain, smear, muddy",
    "used up": "use up, deplete, exhaust, spray, squirt",
    "on !TOGGLEON": "turn on, switch on, light, activate, start, flick on, flip on, power on, "
    "plug in, toggle on, run, illuminate, ignite, operate, boot, kindle, brighten, play, use",
    "off !TOGGLEOFF": "turn off, switch off, turn out, extinguish, blow out, shut off, power off, "
    "shut down, unplug, deactivate, flick off, snuff out, stop, kill, darken, toggle off",
    "opened !OPEN": "open, unlock, open up, pull open, uncover, unfold, unseal",
    "closed !CLOSED": "close, shut, lock, seal, fold, slam, push shut, close up",
    "!HOLDON": "get, pick, grab, fetch, hold, lift, retrieve, remove, seize, obtain, grasp, "
    "pick up, "
    "take out, examine, inspect, raise, study, snatch, acquire, clutch, extract, withdraw",
    "> !HOLDON": "bring, take, carry, collect, gather, give, hand",
    "> @GarbageCan": "discard, dispose, throw away, trash, bin, toss, dump, chuck, throw out, "
    "scrap, recycle, get rid, junk, ditch",
    ">": "put, place, move, set, lay, store, return, leave, drop, transfer, stow, tuck, prop, "
    "lean, "
    "rest, position, arrange, deposit, slide, insert, load, stack, keep, hide, pack, pop, replace, "
    "put away, put back, put down, organise, sort, pile, stash, relocate, stick, pass, push, "
    "spread, deliver, slip",
    "> cleaned": "tidy",
    "> filled @Sink": "pour",
    "> @HandTowelHolder": "hang, drape",
    "> @Shelf": "shelve",
    "> @Plate": "plate, serve, dish up",
    "": "find, locate, search, dry, iron, peel, stir, mix, whisk, dim, adjust, vacuum, cover, "
    "wrap, "
    "check, visit, season, taste, eat, flush, shake, grate, press, make, prepare, count, mash, "
    "rotate, air, blend, knead, feed, wring, scrape, decorate, measure",
}  # fmt: skip


@pytest.mark.parametrize(
    ("verb", "wanted"),
    [(verb.strip(), wanted) for wanted, verbs in VERBS.items() for verb in verbs.split(",")],
)
def test_household_verbs_ask_for_the_right_deed_or_for_none(verb, wanted):
    assert list(clauses_of(f"Find a pen, {verb} the thing")) == [
        "Find a pen", f"{verb} the thing",
    ]  # fmt: skip
    (phrase,) = read_clauses([f"{verb} the thing"])[0]
    parts = wanted.split()
    assert ("used up" in phrase.states) == (wanted == "used up")
    states = [word for word in parts if word[0] not in "@!>"] if wanted != "used up" else []
    assert set(states) <= phrase.states
    assert bool(states) or wanted == "used up" or not phrase.states
    assert {word[1:] for word in parts if word[0] == "@"} <= phrase.done_at
    assert {word[1:] for word in parts if word[0] == "!"} <= phrase.predicates
    assert ">" not in parts or phrase.moves
    if not wanted:
        assert not (phrase.states or phrase.done_at or phrase.predicates or phrase.moves)


def test_verb_table_covers_a_household():
    assert len([verb for verbs in VERBS.values() for verb in verbs.split(",")]) >= 250


@pytest.mark.parametrize(
    ("text", "states", "not_states"),
    [
        ("turn the lamp on", {"on"}, {"off"}),
        ("turn the lamp on the desk off", {"off"}, {"on"}),
        ("put the book on the desk", set(), {"on", "off"}),
        ("leave the door open", {"opened"}, {"closed"}),
        ("make toast", {"cooked"}, {"filled"}),
        ("make some coffee", {"filled"}, {"cooked"}),
        ("ensure that the tv is switched off", {"off"}, {"on"}),
        ("take the bowl out", set(), {"off"}),
    ],
)
def test_particles_of_a_verb_are_told_from_places(text, states, not_states):
    (phrase,) = read_clauses([text])[0]
    assert states <= phrase.states
    assert not phrase.states & not_states


# ----------------------------------------------------------------- properties

THINGS = ["apple", "mug", "butter knife", "cd", "soap bar", "pillow"]
PLACES = ["desk", "counter top", "sink", "fridge", "shelf"]
goal_texts = st.one_of(
    st.builds("ON({}, {})".format, st.sampled_from(THINGS), st.sampled_from(PLACES)),
    st.builds("STATE({}, {})".format, st.sampled_from(THINGS), st.sampled_from(["clean", "hot"])),
    st.builds("TOGGLEON({})".format, st.sampled_from(["lamp", "faucet"])),
)
clause_texts = st.one_of(
    st.builds("put the {} on the {}".format, st.sampled_from(THINGS), st.sampled_from(PLACES)),
    st.builds("wash the {} and heat it".format, st.sampled_from(THINGS)),
    st.sampled_from(["turn on the lamp", "put it back", "store them", "clean up", "sing"]),
)


def chosen(goals, clauses):
    """Return the clause of each goal."""
    found = assign(goals, clauses)
    assert [sub.instruction for sub in found] == list(clauses)
    return [[n for n, sub in enumerate(found) if goal in sub.goals] for goal in goals]


@settings(max_examples=60, deadline=None)
@given(
    st.lists(goal_texts, max_size=5, unique=True), st.lists(clause_texts, min_size=1, max_size=4)
)
def test_every_goal_is_due_in_exactly_one_clause(texts, clauses):
    goals, _ = read_goals(", ".join(texts))
    subtasks = assign(goals, clauses)
    assert sorted(str(goal) for sub in subtasks for goal in sub.goals) == sorted(map(str, goals))
    for sub in subtasks:
        assert set(sub.passing) <= set(sub.goals)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(goal_texts, min_size=1, max_size=5, unique=True),
    st.lists(clause_texts, min_size=1, max_size=4),
    st.data(),
)
def test_spaces_and_case_change_no_clause(texts, clauses, data):
    def spoilt(text):
        loud = data.draw(st.sampled_from([str.upper, str.title, str.lower]))
        gap = data.draw(st.sampled_from([" ", "  ", " \t "]))
        return gap.join(loud(text).split())

    def by_clause(goals, clauses):
        subtasks = assign(goals, clauses)
        return [[goals.index(goal) for goal in sub.goals] for sub in subtasks]

    plain, _ = read_goals(", ".join(texts))
    other = [
        replace(goal, arguments=tuple(spoilt(name) for name in goal.arguments)) for goal in plain
    ]
    assert by_clause(plain, clauses) == by_clause(other, [spoilt(text) for text in clauses])


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 5), st.integers(1, 5))
def test_goals_that_fit_all_clauses_alike_keep_their_order_and_spread_evenly(number, clauses):
    texts = [f"ON({thing}, desk)" for thing in ("pen", "cd", "book", "watch", "vase")[:number]]
    goals, _ = read_goals(", ".join(texts))
    numbers = [one for (one,) in chosen(goals, ["put them away"] * clauses)]
    assert numbers == sorted(numbers)
    counts = [numbers.count(clause) for clause in range(clauses)]
    assert max(counts) <= -(-number // clauses)


@settings(max_examples=60, deadline=None)
@given(st.permutations(["pen", "cd", "book", "watch"]), st.integers(1, 4))
def test_goals_that_each_name_their_own_clause_find_it(things, number):
    goals, _ = read_goals(", ".join(f"ON({thing}, desk)" for thing in things[:number]))
    clauses = [f"put the {thing} on the desk" for thing in things[:number]]
    assert chosen(goals, clauses) == [[n] for n in range(number)]


@settings(max_examples=200, deadline=None)
@given(st.text(max_size=60))
def test_splitting_takes_any_text_and_loses_no_word(text):
    clauses = clauses_of(text)
    assert clauses
    left = words_of(" ".join(clauses))
    assert set(left) <= set(words_of(text))
