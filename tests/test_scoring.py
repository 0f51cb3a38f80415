"""Skill scoring against its definition, on random weights and on the shipped planner."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tiny import export_tiny

from karma.contracts import Prompt
from karma.errors import ModelError
from karma.infer.llama import LlamaModel
from karma.infer.scoring import END, SkillScorer, trie_of

NANO = Path(__file__).parents[1] / "models/nano/planner.gguf"
PROMPT = ("#areas\nunknown\n", "#task put the apple in the fridge\n#memory\n#program\n")
SKILLS = [
    END,
    "GoToObject(robot, 'Apple')\n",
    "GoToObject(robot, 'AppleSliced')\n",
    "GoToObject(robot, 'Fridge')\n",
    "PutObject(robot, 'Apple', 'Fridge')\n",
    "PutObject(robot, 'Apple', 'Fridge')\nCloseObject(robot, 'Fridge')\n",
    "a",
    "go",
]
WORDS = st.text("apb (\n", min_size=1, max_size=9)


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    opened = LlamaModel(export_tiny(tmp_path_factory.mktemp("tiny") / "tiny.gguf"), n_threads=1)
    yield opened
    opened.close()


@pytest.fixture
def scorer(model):
    made = SkillScorer(model)
    yield made
    made.close()


def tokens_of(model, text):
    return [model.end_token] if text == END else model.tokens(text)


def naive(model, prompt, texts):
    """The definition: the whole prompt again for each text, token by token log-probabilities."""
    context = _Plain(model)
    given = [model.tokens(part, begins=i == 0) for i, part in enumerate(prompt)]
    found = np.array([context.score(given, tokens_of(model, text)) for text in texts])
    context.close()
    return found


class _Plain:
    """One sequence, all logits, nothing kept."""

    def __init__(self, model):
        import llama_cpp

        self.model, self.context = model, model.sequences(1, cells=1024)
        self.batch = llama_cpp.llama_batch_init(1024, 0, 1)

    def score(self, prompt, tokens):
        import llama_cpp

        llama_cpp.llama_memory_clear(llama_cpp.llama_get_memory(self.context.ctx), True)
        place = 0
        for part in prompt:
            rows = self.decode(part, place)[-1:]
            place += len(part)
        rows = np.concatenate([rows, self.decode(tokens, place)[:-1]]).astype(np.float64)
        top = rows.max(axis=1)
        total = top + np.log(np.exp(rows - top[:, None]).sum(axis=1))
        return float((rows[np.arange(len(tokens)), tokens] - total).sum())

    def decode(self, tokens, place):
        import llama_cpp

        self.batch.n_tokens = len(tokens)
        for i, token in enumerate(tokens):
            self.batch.token[i], self.batch.pos[i], self.batch.logits[i] = token, place + i, True
            self.batch.n_seq_id[i], self.batch.seq_id[i][0] = 1, 0
        assert llama_cpp.llama_decode(self.context.ctx, self.batch) == 0
        pointer = llama_cpp.llama_get_logits(self.context.ctx)
        shape = len(tokens), self.model.vocabulary
        return np.ctypeslib.as_array(pointer, shape=shape).copy()

    def close(self):
        import llama_cpp

        llama_cpp.llama_batch_free(self.batch)
        self.context.close()


# ----------------------------------------------------------------- all scores


def test_scores_are_the_sums_of_the_definition(model, scorer):
    values = scorer.scores(PROMPT, SKILLS).values
    # in one batch other kernels add up in another order, which long sums show
    assert values == pytest.approx(naive(model, PROMPT, SKILLS), abs=1e-4, rel=2e-5)
    assert (values < 0).all()


def test_average_divides_by_the_number_of_tokens(model, scorer):
    lengths = [len(tokens_of(model, text)) for text in SKILLS]
    sums = scorer.scores(PROMPT, SKILLS).values
    averages = scorer.scores(PROMPT, SKILLS, scoring="average").values
    assert averages == pytest.approx(sums / lengths, abs=1e-12)


def test_a_text_that_begins_another_scores_no_less(model, scorer):
    short, long = SKILLS[4:6]
    assert tokens_of(model, long)[: len(tokens_of(model, short))] == tokens_of(model, short)
    one, other = scorer.scores(PROMPT, [short, long]).values
    assert one > other


def test_one_token_texts_need_no_run(model, scorer):
    texts = [text for text in "abcdefgh" if len(model.tokens(text)) == 1]
    found = scorer.scores(PROMPT, texts)
    assert found.cost.run == 0
    assert found.values == pytest.approx(naive(model, PROMPT, texts), abs=1e-3)
    assert scorer.best(PROMPT, texts).cost.run == 0


def test_equal_texts_score_the_same_and_the_first_is_the_best(scorer):
    values = scorer.scores(PROMPT, ["go go", "go", "go"]).values
    assert values[1] == values[2]
    assert scorer.best(PROMPT, ["go go", "go", "go"]).number == 1


def test_more_texts_than_sequences_take_more_than_one_pass(model, scorer):
    texts = [f"{a}{b}{c}x" for a in "abcdefghij" for b in "klmnopqrst" for c in "uvw"]
    assert len({tuple(model.tokens(text)[:-1]) for text in texts}) > 255
    values = scorer.scores(PROMPT, texts).values
    some = list(range(0, 300, 23))
    assert values[some] == pytest.approx(naive(model, PROMPT, [texts[i] for i in some]), abs=1e-3)
    assert scorer.best(PROMPT, texts).number == int(np.argmax(values))


def test_shared_beginnings_run_once_and_last_tokens_not_at_all(model, scorer):
    lists = [tokens_of(model, text) for text in SKILLS]
    inner = {tuple(tokens[:n]) for tokens in lists for n in range(1, len(tokens))}
    assert scorer.scores(PROMPT, SKILLS).cost.run == len(inner)


def test_one_by_one_equals_the_definition_to_the_last_digits(model, scorer):
    found = scorer.scores(PROMPT, SKILLS, one_by_one=True)
    assert found.values == pytest.approx(naive(model, PROMPT, SKILLS), abs=1e-5)
    together = scorer.scores(PROMPT, SKILLS)
    assert found.cost.run == together.cost.run
    assert scorer.scores(PROMPT, SKILLS).values.tobytes() == together.values.tobytes()


# ----------------------------------------------------------------- the best alone


@given(st.lists(WORDS, min_size=1, max_size=30), st.sampled_from(["sum", "average"]))
@settings(max_examples=40, deadline=None)
def test_best_first_search_finds_the_argmax_of_all_scores(shared_scorer, texts, scoring):
    values = shared_scorer.scores(PROMPT, texts, scoring=scoring).values
    best = shared_scorer.best(PROMPT, texts, scoring=scoring)
    assert best.score == pytest.approx(values.max(), abs=1e-3)
    assert values[best.number] == pytest.approx(values.max(), abs=1e-3)


@pytest.fixture(scope="module")
def shared_scorer(model):
    made = SkillScorer(model)
    yield made
    made.close()


def test_best_runs_less_than_all(model, scorer):
    texts = [f"{a}{b}{c}{d}" for a in "abcdef" for b in "ghijkl" for c in "mnop" for d in "qrst"]
    all_of_them = scorer.scores(PROMPT, texts).cost.run
    assert scorer.best(PROMPT, texts).cost.run < all_of_them / 2


@pytest.mark.parametrize("sequences, cells", [(6, None), (256, 12)])
def test_best_is_the_same_when_room_runs_out(model, sequences, cells):
    texts = [f"{a}{b}{c}{d}" for a in "abcd" for b in "efgh" for c in "ijkl" for d in "mnop"]
    roomy, narrow = SkillScorer(model), SkillScorer(model)
    expected = roomy.best(PROMPT, texts)
    narrow._cache.sequences = sequences
    narrow._cache.cells = expected.cost.prompt + cells if cells else narrow._cache.cells
    found = narrow.best(PROMPT, texts)
    assert found.number == expected.number
    assert found.score == pytest.approx(expected.score, abs=1e-3)
    assert found.cost.run > expected.cost.run
    for one in (roomy, narrow):
        one.close()


# ----------------------------------------------------------------- what is kept


def test_a_kept_prompt_changes_no_bit(model, scorer):
    longer = (*PROMPT, "GoToObject(robot, 'Apple')\n")
    cold = scorer.scores(longer, SKILLS)
    scorer.best(PROMPT, SKILLS)
    scorer.scores(("#other\n",), SKILLS)
    before = scorer.scores(PROMPT, SKILLS)
    warm = scorer.scores(longer, SKILLS)
    assert (before.cost.reused, warm.cost.reused) == (0, before.cost.prompt)
    assert warm.values.tobytes() == cold.values.tobytes()
    again = SkillScorer(model)
    assert again.scores(longer, SKILLS).values.tobytes() == cold.values.tobytes()
    again.close()


def test_scoring_leaves_the_models_kept_prompt_and_answers_alone(model, scorer):
    prompt = Prompt(stable=PROMPT[0], changing=PROMPT[1])
    before = model.complete(prompt, max_tokens=12)
    logits = model.logits()
    scorer.scores(PROMPT, SKILLS)
    scorer.best(PROMPT, SKILLS)
    assert model.logits().tobytes() == logits.tobytes()
    after = model.complete(prompt, max_tokens=12)
    assert (after.text, model.logits().tobytes()) == (before.text, logits.tobytes())
    assert after.reused_tokens > 0


# ----------------------------------------------------------------- refusals


def test_a_prompt_without_room_for_the_longest_text_is_refused(model, scorer):
    with pytest.raises(ModelError, match="context of"):
        scorer.scores(("x " * model.n_ctx,), SKILLS)
    assert scorer.scores(PROMPT, SKILLS).values.shape == (len(SKILLS),)


@pytest.mark.parametrize(
    "prompt, texts, words", [(PROMPT, [], "no continuation"), (("", ""), ["a"], "no prompt")]
)
def test_nothing_to_score_is_refused(scorer, prompt, texts, words):
    with pytest.raises(ValueError, match=words):
        scorer.scores(prompt, texts)


def test_trie_refuses_a_text_without_tokens():
    with pytest.raises(ValueError, match="continuation 1 has no token"):
        trie_of([[1], []])


# ----------------------------------------------------------------- the shipped planner


@pytest.mark.model
def test_shipped_planner_scores_as_defined_and_knows_the_first_step():
    model = LlamaModel(NANO, n_ctx=2048, n_threads=1)
    texts = [f"{skill}(robot, '{name}')\n" for skill in ("GoToObject", "OpenObject", "PickupObject")
             for name in ("Apple", "Fridge", "Mug", "Potato", "CounterTop")]  # fmt: skip
    scorer = SkillScorer(model)
    values = scorer.scores(PROMPT, [END, *texts]).values
    assert values == pytest.approx(naive(model, PROMPT, [END, *texts]), abs=1e-3)
    assert [END, *texts][scorer.best(PROMPT, [END, *texts]).number] == texts[0]
    model.close()
