"""What people say of things and places besides what is to be done: own sentences, by kind."""

import pytest

from karma.plugins.rules.method import reader_of


@pytest.fixture(scope="module")
def reader():
    return reader_of(None)


def told(request):
    """Deeds as "put Pen > Desk (Book)": the thing, its place, and what lies in it."""
    return [
        f"{one.deed or '?'} {'/'.join(one.things[0].types[:2]) if one.things else '-'}"
        + (f" {'near' if one.near else '>'} {one.place.types[0]}" if one.place else "")
        + (f" ({one.things[0].holding[0]})" if one.things and one.things[0].holding else "")
        for one in request.deeds
    ]


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        # parts and sides of a place
        ("lay the sponge on the back of the toilet", ["put DishSponge > Toilet"]),
        ("set the clock down on the left side of the desk", ["put AlarmClock > Desk"]),
        ("put the watch to the right of the laptop", ["put Watch near Laptop"]),
        ("stick the pan in the cabinet below the sink", ["put Pan > Cabinet"]),
        ("store the keys in the bottom drawer of the dresser", ["put KeyChain > Drawer"]),
        ("put the lettuce on the middle shelf of the fridge", ["put Lettuce > Fridge"]),
        ("put the vase on the table in the corner", ["put Vase > CoffeeTable"]),
        # what lies in a thing, and what it is held with
        ("carry the bowl with the egg in it to the counter", ["put Bowl > CounterTop (Egg)"]),
        ("the bowl with the egg goes in the fridge", ["put Bowl > Fridge (Egg)"]),
        ("place a box containing two pens on the bed", ["put Box > Bed (Pen)"]),
        ("switch on the floor lamp while holding the newspaper",
         ["on FloorLamp", "take Newspaper"]),
        ("turn the lamp on with a book in your hand", ["on DeskLamp/FloorLamp", "take Book"]),
        ("inspect the vase in the light of the desk lamp", ["look Vase"]),
        ("bring me a glass of water", ["fill Cup/ShowerGlass", "take Cup/ShowerGlass"]),
        # states ahead of a noun that has no determiner
        ("lay chilled lettuce on the plate", ["put Lettuce > Plate"]),
        ("place rinsed fork in drawer", ["put Fork > Drawer"]),
        ("drop two heads of lettuce into the pot", ["put Lettuce > Pot"]),
        ("move a cooked chunk of potato to the plate", ["put Potato > Plate"]),
        ("cut the bread into slices", ["slice Bread"]),
        ("slice the tomato in half", ["slice Tomato"]),
        ("halve the apple into two halves", ["slice Apple"]),
        ("chop the lettuce into small pieces", ["slice Lettuce"]),
        # results of verbs
        ("push the laptop shut", ["close Laptop"]),
        ("swing the cabinet open", ["open Cabinet"]),
        ("switch on the candle that you switched off", ["on Candle"]),
        # what belongs, what was left, what is wished
        ("the pillow belongs on the bed", ["put Pillow > Bed"]),
        ("the book is meant to be on the shelf", ["put Book > Shelf"]),
        ("somebody left the faucet running", ["off Faucet"]),
        ("I don't want the lamp on any more", ["off DeskLamp/FloorLamp"]),
        ("make sure you don't leave the fridge open", ["close Fridge"]),
        ("get that fork rinsed", ["wash Fork"]),
        ("could you shut the laptop", ["close Laptop"]),
        ("get the soup pot cleaned before the guests arrive", ["wash Pot"]),
        ("I can't bear that lamp, switch it off", ["off DeskLamp/FloorLamp"]),
        ("move a box and sponge to the bed", ["put Box > Bed"]),
        ("rinse the mug then put it on the shelf", ["wash Mug", "put Mug > Shelf"]),
    ],
)  # fmt: skip
def test_deeds_are_read_with_what_is_told_of_their_things(reader, text, wanted):
    request = reader.read(text)[-1]
    assert told(request) == wanted
    assert not request.unread


@pytest.mark.parametrize(
    ("text", "word"),
    [("fetch me a cup of tea", "tea"), ("put the mug on top of the fridge", "on top"),
     ("open the jar with the pen", "with pen")],
)  # fmt: skip
def test_what_cannot_be_had_is_not_left_out(reader, text, word):
    assert word in reader.read(text)[0].unread


def test_cups_are_mugs_only_besides(reader):
    (request,) = reader.read("put the cup on the coffee table")
    assert request.deeds[0].things[0].types == ("Cup",)
    assert "Mug" in request.deeds[0].things[0].besides
    assert request.deeds[0].place.besides == ()  # a coffee table is no other table


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("While you tidy the hall, put two forks in the drawer. It's where they live.",
         ["put Fork > Drawer"]),
        ("When you're settled in the armchair, could you turn on the lamp?",
         ["on DeskLamp/FloorLamp"]),
        ("After shopping in town, rinse the ladle. Cooking tonight is going to be fun!",
         ["wash Ladle"]),
        ("For a quiet night, shut the blinds. That way nobody wakes.", ["close Blinds"]),
        ("Despite the long day, close the curtains.", ["close Curtains"]),
        ("After washing the cup, put it on the shelf.", ["wash Cup", "put Cup > Shelf"]),
    ],
)  # fmt: skip
def test_what_the_hearer_does_meanwhile_is_only_told(reader, text, wanted):
    (request,) = reader.read(text)
    assert (told(request), request.unread, request.times) == (wanted, (), ())


@pytest.mark.parametrize(
    "text", ["For ten minutes, heat the egg.", "When the guests come, turn on the lamp."]
)
def test_what_others_do_first_is_a_time(reader, text):
    assert reader.read(text)[0].times


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("Take the fork. It goes in the drawer.", "put Fork > Drawer"),
        ("Open the box. It needs closing afterwards.", "close Box"),
    ],
)
def test_a_second_sentence_that_asks_is_no_remark(reader, text, wanted):
    asked = [one for request in reader.read(text) for one in told(request)]
    assert wanted in asked


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        # what the parser takes for a verb is a thing, and an order stands without "and"
        ("cool bread and set it on the table", ["cool Bread", "put Bread > CoffeeTable"]),
        ("lay ladle beside kettle", ["put Ladle near Kettle"]),
        ("move newspaper from sofa to shelf", ["put Newspaper > Shelf"]),
        ("stow a fork and mug away in the cabinet", ["put Fork > Cabinet"]),
        ("cut the bread put it on the plate", ["slice Bread", "put Bread > Plate"]),
        ("warm a mug in the microwave, leave it on the desk", ["heat Mug", "put Mug > Desk"]),
        ("carry fork from drawer to sink, rinse fork", ["put Fork > Sink", "wash Fork"]),
        ("set a fork and rinsed plate on the table", ["put Fork > CoffeeTable"]),
        # "to" behind an order leads to one more deed, or says what it is for
        ("cool the egg in the fridge to put in the bowl", ["cool Egg", "put Egg > Bowl"]),
        ("bring the vase to switch on the lamp", ["take Vase", "on DeskLamp/FloorLamp"]),
        ("turn on the lamp to read", ["on DeskLamp/FloorLamp"]),
        ("take the book to the lamp", ["take Book"]),
        ("set the alarm clock beside the lamp", ["put AlarmClock near DeskLamp"]),
        ("carry the mug that you rinsed and dried to the desk", ["put Mug > Desk"]),
        # what "them" stands for
        ("drop the watch in the box and set them on the shelf",
         ["put Watch > Box", "put Watch > Shelf"]),
        ("lay two tomatoes on the counter, then get a knife and slice them",
         ["put Tomato > CounterTop", "take Knife", "slice Tomato"]),
        # a deed at a place is done to the thing before it
        ("grab the plate, heat in the microwave", ["take Plate", "heat Plate"]),
        # where at a place
        ("put the pan on the back left of the stove", ["put Pan > StoveBurner"]),
        ("lay the book on the second shelf", ["put Book > Shelf"]),
        ("bring the soap from the top of the dresser to the sink", ["put SoapBar > Sink"]),
        ("store the spray bottle under the sink", ["put SprayBottle > Cabinet"]),
        ("lay the cloth in the chest of drawers", ["put Cloth > Dresser"]),
        ("set the pot on the counter with the apple in it", ["put Pot > CounterTop (Apple)"]),
    ],
)  # fmt: skip
def test_terse_orders_are_read(reader, text, wanted):
    (request,) = reader.read(text)
    assert told(request) == wanted
    assert request.unread == ()
    assert request.form == "errand"


@pytest.mark.parametrize("text", ["put the green mugs in the sink", "wash the clean white plates"])
def test_a_plural_is_all_of_them_whatever_is_told_of_them(reader, text):
    (request,) = reader.read(text)
    assert request.deeds[0].things[0].every
