"""What requests ask for, from the words alone: real parser, sentences of our own."""

import hashlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.paths import ROOT

from karma.errors import KarmaError
from karma.models.embed.minilm import MiniLm
from karma.plugins.rules.language.clauses import clauses_of, completed, context_left_out, plainly
from karma.plugins.rules.language.lexicon import Lexicon
from karma.plugins.rules.language.request import RequestReader, asked_last, check_length
from karma.plugins.rules.language.slips import as_meant, in_order, spelt
from karma.plugins.rules.parser import SpacyParser

LOCKED = "786d04a94c0f0da1591a48dd88808de4f821c1b11075ed4a1ef853430082330b"
OPEN = "e60155f71daff67478673b706039827b1c90bf897ba35abd4263e5fe7248aad6"


@pytest.fixture(scope="module")
def reader():
    return RequestReader(SpacyParser(), Lexicon(None))


def told(mention):
    if mention is None:
        return ""
    kinds = "/".join(mention.types) or ("*" if mention.anything else "?")
    return kinds + (f" x{mention.number}" if mention.number else " all" if mention.every else "")


def deeds(request):
    """Deeds as "put Egg > Bowl"."""
    return [
        " ".join(filter(None, [one.deed or "?", ", ".join(map(told, one.things))]))
        + (f" {'near' if one.near else '>'} {told(one.place)}" if one.place else "")
        for one in request.deeds
    ]


# ----------------------------------------------------------------- what is to be done


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        # verbs and particles
        ("rinse the spoon and pop it in the drawer", ["wash Spoon", "put Spoon > Drawer"]),
        ("turn the lamp on", ["on DeskLamp/FloorLamp"]),
        ("lights off", ["off LightSwitch"]),
        ("close the tap", ["off Faucet"]),
        ("push the laptop shut", ["close Laptop"]),
        ("put water in the bowl", ["fill Bowl"]),
        ("cut the bread into slices", ["slice Bread"]),
        ("boil the egg, toast bread, wash pot", ["cook Egg", "toast Bread", "wash Pot"]),
        ("on the bed put the cloth", ["put Cloth > Bed"]),
        # wishes, needs, courtesy
        ("could you possibly fetch me my watch", ["take Watch"]),
        ("I'd love the curtains closed", ["close Curtains"]),
        ("the kettle should sit on the stove", ["put Kettle > StoveBurner/StoveKnob"]),
        ("Mary wants the mug washed", ["wash Mug"]),
        ("place rinsed fork in drawer", ["put Fork > Drawer"]),
        ("put a fork and rinsed plate on the counter", ["put Fork, Plate > CounterTop"]),
        ("somebody left the faucet running", ["off Faucet"]),
        ("sponge on the counter", ["put DishSponge > CounterTop"]),
        ("get the tomato hot and the apple cold", ["heat Tomato", "cool Apple"]),
        ("bring me a cold apple", ["cool Apple", "take Apple"]),
        # lists, numbers, alternatives
        ("put the mug in the sink or on the shelf", ["put Mug > Sink/Shelf"]),
        ("toss every newspaper in the bin", ["put Newspaper all > GarbageCan"]),
        ("bring four plates to the dining table", ["put Plate x4 > DiningTable"]),
        ("clear the shelf, everything on it goes in the box", ["put * all > Box"]),
        ("set one vase on the shelf and the other on the desk",
         ["put Vase x1 > Shelf", "put Vase > Desk"]),
        # places, and what says which object is meant
        ("slide the laptop next to the vase", ["put Laptop near Vase"]),
        ("put the lettuce on the middle shelf of the fridge", ["put Lettuce > Fridge"]),
        ("stick the pan in the cabinet below the sink", ["put Pan > Cabinet"]),
        ("carry the mug that you rinsed and dried to the desk", ["put Mug > Desk"]),
        # order, corrections, remarks
        ("before you slice the loaf, rinse the knife", ["wash Knife", "slice Bread"]),
        ("1. open the box 2. put the pen in it 3. shut it",
         ["open Box", "put Pen > Box", "close Box"]),
        ("put the book on the desk... actually the shelf", ["put Book > Shelf"]),
        ("While you tidy up, put a fork in the drawer. It's where they live.",
         ["put Fork > Drawer"]),
        ("I can't bear that lamp, switch it off", ["off DeskLamp/FloorLamp"]),
    ],
)  # fmt: skip
def test_deeds_are_parsed(reader, text, wanted):
    requests = reader.read(text)
    assert [one for request in requests for one in deeds(request)] == wanted
    assert not any(request.unread for request in requests)


@pytest.mark.parametrize(
    ("text", "forbidden", "ruled_out"),
    [
        ("warm the bread but never touch the egg", [], ["Egg"]),
        ("put the pot on the stove and don't switch it on", ["on"], []),
        ("shelve the books except the red one", [], []),
        ("take the tray instead of the bowl", [], ["Bowl"]),
        ("place the cup on the desk, not on the bed", [], ["Bed"]),
        ("slice the apple without using the butter knife", [], ["ButterKnife"]),
        ("close all the drawers but the safe", [], ["Safe"]),
        ("leave the candle alone and wash the cloth", [], ["Candle"]),
    ],
)
def test_what_is_ruled_out_is_read_and_is_no_part_of_the_errand(reader, text, forbidden, ruled_out):
    (request,) = reader.read(text)
    assert [one.deed for one in request.forbidden] == forbidden
    kinds = [kind for one in request.exclusions for kind in one.types]
    assert set(ruled_out) <= set(kinds)
    done = {kind for one in request.mentions for kind in one.types}
    assert not done & set(ruled_out)
    assert not any(word in request.errand.split() for word in ("not", "n't", "without", "instead"))


@pytest.mark.parametrize(
    ("text", "form"),
    [
        ("where did the ladle go?", "question"),
        ("which of the bowls is clean", "question"),
        ("my son broke the vase", "statement"),
        ("pans always live under the sink", "teaching"),
        ("thanks", "talk"),
        ("put the kettle on the", "incomplete"),
        ("wash", "incomplete"),
        ("the spatula", "incomplete"),
        ("why don't you wash the pan", "errand"),
        ("would you mind closing the drawer?", "errand"),
    ],
)
def test_forms_are_told_apart(reader, text, form):
    assert [one.form for one in reader.read(text)] == [form]


@pytest.mark.parametrize(
    ("text", "time"),
    [
        ("boil the egg at eight", "at eight"),
        ("in a quarter of an hour open the blinds", None),
        ("switch the lamp off after dinner", "after dinner"),
        ("chill the wine for twenty minutes", "for twenty minutes"),
        ("wash up when the guests have left", "when the guests have left"),
        ("every morning, water the plant", "every morning"),
    ],
)
def test_times_are_never_dropped(reader, text, time):
    (request,) = reader.read(text)[-1:]
    assert request.times or request.unread
    if time:
        assert request.times == (time,)
        assert time not in request.errand


@pytest.mark.parametrize(
    ("text", "state", "holds"),
    [
        ("if the mug is dirty, rinse it", "dirty", True),
        ("rinse the mug unless it is clean", "clean", False),
        ("in case the telly is on, switch it off", "on", True),
        ("if there is a fork on the table, put it in the drawer", "there", True),
        ("only if the fridge isn't closed, shut it", "closed", False),
    ],
)
def test_conditions_are_read(reader, text, state, holds):
    (request,) = reader.read(text)
    (condition,) = request.conditions
    assert condition.holds is holds
    assert condition.state == state or not condition.thing
    assert request.deeds and "if" not in request.errand.split()


@pytest.mark.parametrize(
    ("text", "states"),
    [
        ("wash the mugs unless they are clean", ("dirty",)),
        ("turn the lamps off if they're on", ("on",)),
        ("if the drawers are open, close them", ("opened",)),
        ("put every mug in the sink if it's dirty", ("dirty",)),
    ],
)
def test_a_condition_of_each_tells_which_are_meant(reader, text, states):
    (request,) = reader.read(text)
    assert request.conditions == ()
    assert request.deeds[0].things[0].states == states


@pytest.mark.parametrize(
    ("text", "at", "place"),
    [
        ("put the fork in the drawer on the dining table", ("Drawer",), "DiningTable"),
        ("put the forks in the drawers on the table", ("Drawer",), "CoffeeTable"),
        ("put the cup in the cabinet in the sink", ("Cabinet",), "Sink"),
        ("put the pen in the drawer of the desk", (), "Drawer"),
        ("put the pen in the drawer on the desk", (), "Drawer"),
        ("put the pen in the desk's drawer", (), "Drawer"),
        ("put the cup on the shelf in the cabinet", (), "Cabinet"),
    ],
)
def test_a_drawer_is_where_it_goes_or_where_it_lies(reader, text, at, place):
    (request,) = reader.read(text)
    (deed,) = request.deeds
    assert deed.things[0].at == at
    assert deed.place.types[0] == place
    assert deed.place.at == (("Desk",) if "desk" in text else ())


def test_words_that_no_field_holds_are_kept(reader):
    for text, word in (
        ("polish the mug with the toothbrush", "toothbrush"),
        ("fold the towel", "fold"),
        ("put the mug on the desk like a waiter", "waiter"),
    ):
        (request,) = reader.read(text)
        assert any(word in one for one in request.unread) or any(
            not thing.types for thing in request.mentions
        )


def test_other_languages_are_told(reader):
    for text in ("mets la tasse dans l'évier", "コップを洗って", "wasch den Teller ab"):
        assert not any(one.english for one in reader.read(text))


# ----------------------------------------------------------------- what was meant


@pytest.mark.parametrize(
    ("said", "meant"),
    [
        ("WASH THE PLATE", "wash the plate"),
        ("um, so, uh wash the the plate, ta", "so, wash the plate"),
        ("bring the fork, no wait, the spoon", "bring the spoon"),
        ("put the pen on the bed, sorry, in the drawer", "put the pen in the drawer"),
        ("- wash the mug\r\n- dry land", "wash the mug. dry land"),
        ("wash the cup, won't... no: leave it", "leave it"),
    ],
)
def test_slips_are_left_out(said, meant):
    assert as_meant(said) == meant


def test_spelling_is_mended_by_one_slip_only():
    right = ["lettuce", "drawer", "pencil", "turn"]

    def known(word):
        return word in ("the", "unicorn")

    assert spelt("the lettuse", known, right) == "the lettuce"
    assert spelt("the drawr", known, right) == "the drawer"
    assert spelt("trun", known, right) == "turn"
    assert spelt("the drafts unicorn", known, right) == "the drafts unicorn"


def test_order_is_by_what_comes_first():
    said = in_order("heat the cup after washing it")
    assert said == "wash the cup, then heat the cup"
    same = "heat the cup after dinner"
    assert in_order(same) == same


@settings(max_examples=150, deadline=None)
@given(st.text(alphabet=st.characters(codec="utf-8", exclude_categories=("Cs",)), max_size=80))
def test_any_text_is_read_the_same_each_time(text):
    reader = RequestReader(SpacyParser(), Lexicon(None)) if not _KEPT else _KEPT[0]
    _KEPT[:] = [reader]
    reader._kept.clear()
    first = reader.read(text)
    reader._kept.clear()
    assert reader.read(text) == first
    for request in first:
        assert request.form in ("errand", "question", "statement", "teaching", "talk", "incomplete")
        for one in request.mentions:
            assert request.whole[max(one.start, 0) : one.end] or one.start < 0


_KEPT: list[RequestReader] = []


# ----------------------------------------------------------------- cut, and answered


def test_errands_are_cut_where_people_would(reader):
    (request,) = reader.read("take the fork and the spoon to the sink and wash the fork")
    assert [text for text, _ in clauses_of(request)] == [
        "put the fork in the sink", "put the spoon in the sink", "wash the fork",
    ]  # fmt: skip
    assert all(len(asked.deeds) == 1 for _, asked in clauses_of(request))


def test_what_is_only_told_beside_an_errand_is_context(reader):
    requests = reader.read("I can't find the ladle. Could you get it for me?")
    (kept,) = context_left_out(requests)
    assert deeds(kept) == ["take Ladle"]
    told_only = reader.read("I can't find the ladle.")
    assert context_left_out(told_only) == told_only


@pytest.mark.parametrize(
    ("text", "unread"),
    [
        ("put the book under the bed", ("under bed",)),
        ("put the mug under the sink", ()),
        ("put the cup upside down in the sink", ("upside down",)),
        ("cut the tomato in half", ()),
        ("if the lamp is on turn it off, otherwise turn it on", ("otherwise",)),
        ("put the pepper between the plate and the potato", ("between",)),
        ("put the books on the shelf except one", ("except one",)),
        ("put all but one of the eggs in the bowl", ("all but one",)),
        ("read the newspaper to me", ("read",)),
    ],
)
def test_what_the_world_has_no_way_for_is_not_passed_over(reader, text, unread):
    (request,) = reader.read(text)
    assert request.unread == unread


@pytest.mark.parametrize(
    ("text", "states"),
    [
        ("close everything that is open", ("opened",)),
        ("turn off whatever is on", ("on",)),
        ("wash the plates that aren't clean", ("dirty",)),
        ("turn off the lamp that is on the desk", ()),
    ],
)
def test_states_that_things_are_told_by_are_no_deeds(reader, text, states):
    (request,) = reader.read(text)
    assert len(request.deeds) == 1
    assert request.deeds[0].deed in ("close", "off", "wash")
    assert request.deeds[0].things[0].states == states
    assert request.unread == ()


@pytest.mark.parametrize(
    ("text", "left_out"),
    [
        ("wash every cloth except the one in the drawer", ("Cloth", "Drawer", "")),
        ("put all the books on the bed but not the one on the desk", ("Book", "Desk", "")),
        ("wash all the plates but not the dirty ones", ("Plate", "", "dirty")),
        ("put the dirty bowl, not the clean one, in the sink", ("Bowl", "", "clean")),
        ("put everything except the mug in the sink", ("Mug", "", "")),
    ],
)
def test_what_is_left_out_may_be_told_by_its_place_or_state(reader, text, left_out):
    (request,) = reader.read(text)
    (one,) = request.exclusions
    assert (one.types[0], "".join(one.at[:1]), "".join(one.states[:1])) == left_out
    assert not request.deeds[0].things[0].at


@pytest.mark.parametrize(
    ("text", "marks"),
    [
        ("put the book in the second drawer", ("second",)),
        ("open the cabinet on the right", ("right",)),
        ("wash the red mug", ("red",)),
        ("put everything in the left drawer on the desk", ("left",)),
        ("put the spoon in the drawer", ()),
        ("put the bowl on the coffee table", ()),
    ],
)
def test_words_that_no_look_shows_are_kept_with_what_they_tell_of(reader, text, marks):
    (request,) = reader.read(text)
    named = [word for one in request.mentions for word in one.marks]
    assert tuple(dict.fromkeys(named)) == marks


def test_it_may_stand_for_what_was_said_before(reader):
    (before,) = reader.read("wash the apple")
    (request,) = reader.read("put it in the fridge", before.mentions)
    assert deeds(request) == ["put Apple > Fridge"]
    (alone,) = reader.read("put it in the fridge")
    assert alone.form == "incomplete"


@pytest.mark.parametrize(
    ("turns", "wanted"),
    [
        (["put the pen and the pencil on the shelf", "put them on the desk"],
         ["put Pen, Pencil > Desk"]),
        (["turn on the floor lamp", "and the desk lamp", "turn them both off"],
         ["off FloorLamp, DeskLamp"]),
        (["wash the fork", "the spoon too", "put them in the drawer"],
         ["put Fork, Spoon > Drawer"]),
        (["put the pen in the mug", "put them on the desk"], ["put Pen, Mug > Desk"]),
        (["take the pen", "and the pencil", "put both of them on the desk"],
         ["put Pen, Pencil > Desk"]),
        (["put the pen in the box", "take it out"], ["take Pen"]),
        (["put both pillows on the sofa", "put one of them on the bed"], ["put Pillow x1 > Bed"]),
        (["wash the cups", "put both on the shelf"], ["put Cup x2 > Shelf"]),
        (["put the apple in the fridge", "where is it?", "and the bread"], ["put Bread > Fridge"]),
        (["put the pen on the desk; wash the mug", "and the spoon"], ["wash Spoon"]),
    ],
)  # fmt: skip
def test_what_is_said_goes_on_from_the_turn_before(reader, turns, wanted):
    named, last = (), ()
    for text in turns:
        read = reader.read(text, named, last)
        said = [one for request in read for one in (*request.alone, *request.mentions)]
        named = tuple(one for one in said if one.types) or named
        for request in read:
            last = asked_last(request, last)
    assert deeds(read[-1]) == wanted


@pytest.mark.parametrize(
    ("before", "question", "about"),
    [
        ("put the apple in the fridge", "where is it?", [("Apple",)]),
        ("put the apple in the fridge", "is it open?", [("Fridge",)]),
        ("put the apple in the fridge", "what is in it?", [("Fridge",)]),
        ("wash the fork and the spoon", "where are they?", [("Fork",), ("Spoon",)]),
        ("turn on the floor lamp", "is it still on?", [("FloorLamp",)]),
    ],
)
def test_a_question_s_pronoun_stands_for_what_can_be_so(reader, before, question, about):
    (errand,) = reader.read(before)
    (request,) = reader.read(question, errand.mentions, errand.deeds)
    assert [one.types for one in request.alone] == about


def test_things_may_be_told_by_what_they_are_for():
    reader = RequestReader(SpacyParser(), Lexicon(MiniLm()))
    for text, kind in (
        ("bring me something to write with", "Pen"),
        ("throw the thing to read in the bin", "Book"),
        ("find the thing that tells the time", "AlarmClock"),
    ):
        (request,) = reader.read(text)
        assert kind in request.deeds[0].things[0].types
        assert len(request.deeds) == 1 and not request.unread


def test_plain_words_name_types(reader):
    (request,) = reader.read("sling the tabloid in the wastebasket")
    assert plainly(request) == "put the newspaper in the garbage can"


@pytest.mark.parametrize(
    ("asked", "answer", "whole"),
    [
        ("lay the book on my", "desk", "lay the book on my desk"),
        ("bring it here", "the fork", "bring the fork here"),
        ("put the cup", "on a shelf", "put the cup on a shelf"),
    ],
)
def test_an_answer_completes_what_was_asked_back(asked, answer, whole):
    assert completed(asked, answer) == whole


def test_locked_requests_are_those_that_were_written_before():
    folder = ROOT / "eval/requests"
    for name, wanted in (("asked_locked", LOCKED), ("asked_open", OPEN)):
        assert hashlib.sha256((folder / f"{name}.jsonl").read_bytes()).hexdigest() == wanted


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("take the newspaper. put the mug there", None),
        ("open the drawer. put the mug there", ("Drawer",)),
        ("take the mug. put it over there", None),
        ("wash the bowl, then put the egg there", ("Bowl",)),
    ],
)  # fmt: skip
def test_there_is_a_place_that_was_named_and_can_hold(reader, text, place):
    *_, last = [request for request in reader.read(text) if request.deeds]
    found = last.deeds[-1].place
    assert (found.types or None if found is not None else None) == place
    assert (last.lacking == "where") == (place is None)


@pytest.mark.parametrize(
    "text",
    ["once the lamp is off, bring me the mug", "the knife is off limits, slice the apple",
     "the fridge is to stay closed, put the apple on the counter",
     "the plate is not to be touched, wash the mug", "the pan is taken, get the egg and cook it",
     "the fridge has to stay shut, put the apple in the bowl"],
)  # fmt: skip
def test_what_may_rule_something_out_is_no_remark_that_is_left_out(reader, text):
    (request,) = reader.read(text)
    assert request.unread or request.exclusions or request.conditions or request.times


@pytest.mark.parametrize(
    "text",
    [
        "put the mugs next to each other on the table", "put both remotes side by side on the sofa",
        "stack the plates on top of one another", "put the cups at opposite ends of the table",
        "put all the toilet paper in the cabinet apart from one roll",
        "put the lighter of the two books on the shelf", "give me the nearer one",
    ],
)  # fmt: skip
def test_what_nothing_looks_at_is_left_unread(reader, text):
    assert any(one.unread for one in reader.read(text))


@pytest.mark.parametrize(
    ("text", "of", "holds"),
    [
        ("if either mug is dirty, open the fridge", "any", True),
        ("if neither mug is on the table, open the fridge", "any", False),
        ("if both mugs are clean, put them on the table", "all", True),
        ("unless all the drawers are closed, open the fridge", "all", False),
        ("if the lamps are on, open the fridge", "each", True),
        ("if the mug is dirty, open the fridge", "one", True),
        ("when you see the pen, open the fridge", "one", True),
    ],
)
def test_a_condition_is_of_so_many(reader, text, of, holds):
    (request,) = reader.read(text)
    (condition,) = request.conditions
    assert (condition.of, condition.holds) == (of, holds)
    assert condition.state
    assert [one.deed for one in request.deeds] == [request.deeds[0].deed]


def test_what_is_too_long_to_be_said_is_refused():
    check_length("put the apple in the fridge " * 100)
    with pytest.raises(KarmaError, match="say it in several"):
        check_length("put the apple in the fridge " * 400)
