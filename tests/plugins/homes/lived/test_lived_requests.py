"""Requests of residents in homes as they are lived in: their truth by the log, the reader."""

from typing import get_args

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from karma.models.embed.minilm import MiniLm
from karma.plugins.homes.lived.drawing import draw_request
from karma.plugins.homes.lived.experiment import LivedExperiment, LivedRow
from karma.plugins.homes.lived.play import HomeLife
from karma.plugins.homes.lived.reading import Reader
from karma.plugins.homes.lived.request import LivedKind, done
from karma.plugins.rules.language.clock import read_span, spans
from karma.seeds import stream
from tests.support.lived import DAY_S, HOUR_S
from tests.support.lived_oracle import MOVES, places_at

KINDS = get_args(LivedKind)
ROW = LivedRow(name="none", design="none")


@pytest.fixture(scope="module")
def reader():
    return Reader(MiniLm())


@pytest.fixture(scope="module")
def drawn(reader):
    """Return requests of all kinds, each with the view that it was drawn from."""
    found = []
    for home in range(2):
        experiment = LivedExperiment(
            name="x", benchmark="lived", rows=(ROW,), homes=1, first_home=home + 60, days=4
        )
        spec = next(experiment.specs())
        life = HomeLife(experiment, ROW, spec, 0, reader)
        for day in range(4):
            life.day(day)
            view = life._view()
            for kind in KINDS:
                for number in range(3):
                    rng = stream(7, "test", "requests", str(home), str(day), kind, str(number))
                    request = draw_request(view, kind, rng)
                    if request is not None:
                        found.append((request, view))
    return found


def furniture(view, place_id, where):
    """Return the furniture that a place is, or is on."""
    for _ in range(5):
        if place_id in view.places or place_id is None:
            return place_id
        place_id = where.get(place_id)
    return place_id


def test_what_is_right_in_a_home_is_what_its_log_says(drawn):
    for request, view in drawn:
        where = places_at(view.start, view.log, request.before_s or view.time_s)
        mine = [deed for deed in view.log if deed.object_id in request.object_ids]
        match request.asked:
            case "place":
                places = {furniture(view, where[one], where) for one in request.object_ids}
                assert places <= set(request.places)
                types = {one.object_type for one in view.now.values()}
                assert (request.object_type in types) != request.unknown
            case "count":
                assert request.count == sum(
                    one.object_type == request.object_type
                    and furniture(view, where[key], where) in request.places
                    for key, one in view.start.items()
                )
            case "who":
                assert [one for one in mine if one.action in MOVES][-1].who == request.who
            case "time":
                assert any(request.after_s <= one.time_s <= request.before_s for one in mine)
            case _:
                assert not done(request, view.now)
        if request.kind in ("changed", "exact"):
            last = {one.object_id: one for moment in view.seen for one in moment.seen}
            (thing,) = request.object_ids
            same = last[thing].place_id == view.now[thing].place_id
            assert same == (request.kind == "exact")
    assert {request.kind for request, _ in drawn} == set(KINDS)
    assert {request.asked for request, _ in drawn} >= {"place", "count", "time", "errand"}


def test_the_reader_reads_what_it_was_not_told(drawn, reader):
    read = {"asked": [], "type": [], "who": [], "span": [], "destination": []}
    for request, view in drawn:
        question = reader.read(request.text, request.speaker, request.time_s)
        assert question.unread == (), request.text
        read["asked"].append(question.asked == request.asked)
        if request.object_type:
            read["type"].append(
                bool(question.thing.types) and question.thing.types[0].name == request.object_type
            )
        if request.kind == "event":
            read["who"].append(bool(question.thing.who) and question.thing.who in view.people)
            read["span"].append(question.thing.before_s is not None)
        if request.asked == "errand":
            read["destination"].append(question.destination is not None)
    shares = {name: sum(found) / len(found) for name, found in read.items() if found}
    assert shares["asked"] == 1.0
    assert shares["destination"] == 1.0
    assert shares["who"] > 0.95
    assert shares["type"] > 0.9


@settings(max_examples=80, deadline=None)
@given(st.floats(6 * HOUR_S, 20 * DAY_S))
def test_times_said_are_read_back(now_s):
    for span in spans(now_s):
        found, rest = read_span(f"the cup that Ann washed {span.words}", now_s)
        assert (found.after_s, found.before_s) == (span.after_s, span.before_s)
        assert rest == "the cup that Ann washed"
        assert span.before_s <= now_s


NOW_S = 9 * DAY_S + 10 * HOUR_S  # a Wednesday


@pytest.mark.parametrize(
    ("said", "hours"),
    [
        ("last night", (-16, -5)),
        ("an hour ago", (-1.5, -0.5)),
        ("two days ago", (-58, -34)),
        ("last Monday", (-58, -34)),
        ("Monday morning", (-53, -46)),
        ("last Wednesday", (-178, -154)),
        ("at noon", (-22.5, -21.5)),
        ("at seven", (-3.5, -2.5)),
        ("at 7 pm yesterday", (-15.5, -14.5)),
        ("the day before yesterday", (-58, -34)),
    ],
)
def test_times_are_read(reader, said, hours):
    question = reader.read(f"where was the mug {said}?", "Ann", NOW_S)
    assert question.unread == ()
    span = (question.thing.after_s, question.thing.before_s)
    assert span == tuple(NOW_S + one * HOUR_S for one in hours)


@pytest.mark.parametrize(
    ("text", "unread"),
    [
        ("where was the mug last week?", "last week"),
        ("where was the mug before dinner?", "before dinner"),
        ("where was the mug a few days ago?", "a few days ago"),
        ("where was the mug at 25:00?", "25:00"),
        ("where was the mug in March?", "in March"),
        ("where was the mug this evening?", "this evening"),  # it is morning
        ("how many cups are on the desk at noon?", "at noon"),  # what is counted is what is now
        ("put the mug on the desk at seven", "at seven"),
        ("when did my daughter wash the mug?", "my daughter"),
        ("where is the cup that she washed?", "she"),
        ("where is the cup ann washed?", "ann washed"),
        ("where is the cup that Ann threw away?", "that Ann threw away"),
    ],
)
def test_words_that_are_not_understood_are_told(reader, text, unread):
    assert unread in reader.read(text, "Ben", NOW_S).unread


@pytest.mark.parametrize("who", ["Ben", "Mary Ann", "Jean-Luc", "O'Brien", "李明", "ann", "Żaneta"])
def test_people_of_any_script_are_read(reader, who):
    for text in (
        f"where is the mug that {who} washed this morning?", f"when did {who} wash the mug?",
        f"where did {who} put the mug?",
    ):  # fmt: skip
        question = reader.read(text, "Cem", NOW_S)
        assert (question.thing.who, question.unread) == (who, ()), text
