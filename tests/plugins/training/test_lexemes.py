"""Words that no planner is trained on: a third of ours, and said by nothing that feeds training."""

from hashlib import sha256
from itertools import chain

import pytest

from karma.files import to_json, write_atomic
from karma.goals.files import load_tasks
from karma.plugins.rules.language.lexemes import (
    Lexemes,
    UnseenWords,
    every_word,
    held_out,
    lexicon,
    unseen_lexemes,
    unseen_lexicon,
)
from karma.plugins.training.drawing.drawn_tasks import draw_task
from karma.plugins.training.drawing.memories import generated_rooms, room_of
from karma.plugins.training.drawing.phrases import our_book
from karma.plugins.training.drawing.requests import KINDS
from karma.plugins.training.hinted import called, words_file
from karma.plugins.training.packs import PlannerRecipe, draw_pack
from karma.plugins.training.sources import Sources
from karma.plugins.training.task_files import draw_tasks, fresh_rooms
from karma.seeds import stream
from karma.world.core import scene

BOOK = our_book()
UNSEEN = unseen_lexemes()


def in_the_third(text):
    """The rule said again: a hash of the text decides, and nothing else."""
    return int.from_bytes(sha256(text.encode()).digest(), "big") % 3 == 0


# ----------------------------------------------------------------- the rule


def words_of_class(name):
    if name == "verbs":
        return {*chain.from_iterable(BOOK.verbs.values())}
    if name == "adjectives":
        return {*chain.from_iterable((*BOOK.adjectives.values(), *BOOK.just.values()))}
    return {*chain.from_iterable(getattr(entry, name) for entry in every_word().values())}


def test_held_out_lexemes_are_words_of_ours_of_their_class():
    for name in UnseenWords.__struct_fields__:
        texts = getattr(held_out(), name)
        assert texts, name
        assert sorted(set(texts)) == list(texts)
        assert set(texts) <= words_of_class(name)


def test_held_out_lexemes_are_of_the_third_or_have_one_in_them_that_is():
    drawn = Lexemes(text for text in held_out().texts if in_the_third(text))
    assert [text for text in held_out().texts if not drawn.found_in(text)] == []


# ----------------------------------------------------------------- what feeds training


def test_no_word_for_a_thing_that_training_has_is_held_out_or_has_one_in_it():
    said = [word for entry in lexicon().values() for word in entry.words]
    assert [word for word in said if UNSEEN.found_in(word)] == []
    assert len(said) + sum(
        word in held_out().things for entry in every_word().values() for word in entry.words
    ) == sum(len(entry.words) for entry in every_word().values())


@pytest.mark.parametrize("part", [False, True])
def test_no_phrase_of_either_side_of_the_templates_has_a_held_out_lexeme(part):
    book = BOOK.part(held_out=part)
    texts = chain(
        *book.templates.values(), *book.adjectives.values(), *book.just.values(),
        *book.around.values(), *book.references.values(),
        *book.spoken.values(),
    )  # fmt: skip
    assert [text for text in texts if UNSEEN.found_in(text)] == []


def test_no_text_that_hints_come_from_has_a_held_out_lexeme():
    file = words_file(())
    texts = (*chain(*file.types.values(), *file.deeds.values()), *called())
    assert len(texts) > 3000
    assert [text for text in texts if UNSEEN.found_in(text)] == []
    assert file.phrases.isdisjoint(held_out().texts)


def sources_in(folder, shared):
    """Return sources with a few rooms of our own: what is said does not hang on where."""
    write_atomic(folder / "rooms.json", to_json(list(generated_rooms(8, 0))))
    return Sources(folder=folder, shared=shared, tests=())


def said_by(sources, packs):
    """Return sampled sentences by kind of example; hints repeat their phrases and name types."""
    recipe = PlannerRecipe()
    data = sources.material(recipe)
    found = {}
    for number in range(packs):
        for example in draw_pack(recipe, data, "proof", str(number)):
            found.setdefault(example.kind, []).append(example.sentence)
    return found


def test_stream_without_reference_data_says_no_held_out_lexeme(tmp_path):
    found = said_by(sources_in(tmp_path, tmp_path), 200)
    assert {*KINDS, "pair", "refuse_thing"} <= found.keys()
    assert sum(map(len, found.values())) > 800
    assert [text for texts in found.values() for text in texts if UNSEEN.found_in(text)] == []


@pytest.mark.shared
def test_stream_with_reference_data_says_no_held_out_lexeme(shared, tmp_path):
    sources = sources_in(tmp_path, shared)
    if not sources.demonstrations.exists():
        pytest.skip(f"needs {sources.demonstrations}")
    found = said_by(sources, 200)
    assert {"alfred", "refuse_thing"} <= found.keys()
    assert [text for texts in found.values() for text in texts if UNSEEN.found_in(text)] == []


# ----------------------------------------------------------------- tasks in held-out words


def test_words_that_training_lacks_are_all_there_is_where_there_are_any():
    for kind, entry in unseen_lexicon().items():
        theirs = held_out().things & set(every_word()[kind].words)
        assert set(entry.names) <= theirs or set(entry.names) <= set(lexicon()[kind].names)
        assert theirs <= set(entry.words)


def test_tasks_in_held_out_words_each_have_one(tmp_path):
    drawn = draw_tasks(
        tmp_path, BOOK.with_unseen_words(), scenes=list(fresh_rooms(2, 0)), each=4, seed=0,
        filtered=False, unseen=True,
    )  # fmt: skip
    tasks = load_tasks(tmp_path / "tasks.jsonl")
    numbers = [sum(UNSEEN.number_in(sub.instruction) for sub in t.subtasks) for t in tasks]
    assert len(tasks) == drawn.tasks == 12
    assert min(numbers) > 0
    assert sum(drawn.lexemes.values()) == 12
    assert sorted(drawn.lexemes.elements()) == sorted(numbers)


def test_ordinary_drawn_tasks_have_none():
    rooms = [room_of(scene.load(name), name) for name in ("kitchen_1", "bedroom_1")]
    book = BOOK.part(held_out=True)
    for number in range(60):
        task = draw_task(stream(0, "plain", str(number)), rooms[number % 2], book, "composite")
        assert not [step.text for step in task or () if UNSEEN.found_in(step.text)]
