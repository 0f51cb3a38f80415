"""Real weights: how they are named, opened through their template, and bounded by the clock.

SmolLM2-135M, which `make setup` brings where it can be had; the tests with it skip elsewhere. What
does not need what it has learnt is tried with random weights too.
"""

import subprocess
import sys

import pytest
from support.tiny import export_tiny

from karma.errors import ModelError
from karma.models.llama.model import LlamaModel
from karma.models.manifest import find_model
from karma.testing import make_planner
from karma.types.planning import Prompt

NAME = "smollm2-135m"
QUESTION = Prompt(stable="You answer in one word.\n", changing="What is the capital of France?")
THROUGH, WITHOUT = "through its own chat template", "without its own chat template"


@pytest.fixture(scope="module")
def real(smollm):
    model = LlamaModel(smollm, sha256=find_model(NAME).files[0].sha256)
    yield model
    model.close()


def test_real_weights_are_found_and_nothing_of_their_package_is_imported(smollm):
    code = (
        "import sys\n"
        "from karma.models.manifest import resolve_planner\n"
        f"print(resolve_planner({NAME!r}).path)\n"
        "print([name for name in sys.modules if 'smol' in name])\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == [str(smollm), "[]"]


def test_real_model_answers_through_its_template_and_ends_by_itself(real):
    said = real.complete(QUESTION, max_tokens=60)
    assert real.manner == THROUGH
    assert "Paris" in said.text
    assert said.finish == "stop"


def test_real_model_without_its_template_reads_the_bare_text(smollm, real):
    sha256 = find_model(NAME).files[0].sha256
    raw = LlamaModel(smollm, chat=False, sha256=sha256)
    assert raw.manner == WITHOUT
    bare, wrapped = (one.complete(QUESTION, max_tokens=1).prompt_tokens for one in (raw, real))
    assert bare < wrapped
    raw.close()


def test_template_that_cannot_be_used_is_told_with_the_way_round_it(tmp_path):
    path = export_tiny(tmp_path / "tiny.gguf", template="{{ raise_exception('no') }}")
    with pytest.raises(ModelError, match=r"cannot be used: no(.|\n)*models.chat=false"):
        LlamaModel(path).complete(QUESTION)
    assert LlamaModel(path, chat=False).complete(QUESTION, max_tokens=2).completion_tokens


# ----------------------------------------------------------------- while it comes


def test_answer_is_heard_piece_by_piece_and_the_pieces_are_the_answer(real):
    heard = []
    said = real.complete(QUESTION, max_tokens=60, listen=heard.append)
    assert "".join(one.text for one in heard) == said.text
    assert [one.tokens for one in heard] == list(range(1, said.completion_tokens + 1))
    seconds = [one.seconds for one in heard]
    assert seconds == sorted(seconds) and seconds[-1] <= said.total_s
    assert said.text == real.complete(QUESTION, max_tokens=60).text  # hearing changes nothing


def test_letters_of_several_tokens_are_heard_whole(tmp_path):
    model = LlamaModel(make_planner(tmp_path / "tiny.gguf", "llama3"), chat=False)
    for seed in range(20):
        heard = []
        drawn = {"max_tokens": 40, "temperature": 1.5, "seed": seed}
        said = model.complete(QUESTION, listen=heard.append, **drawn)
        pieces = "".join(one.text for one in heard)
        assert said.text.rstrip("\ufffd").startswith(pieces.rstrip("\ufffd"))
        assert len(pieces) >= len(said.text) - 4


# ----------------------------------------------------------------- the clock


class Clock:
    """A clock that goes on by a second each time it is looked at."""

    def __init__(self):
        self.now = 0

    def __call__(self):
        self.now += 1
        return float(self.now)


@pytest.fixture
def clocked(monkeypatch):
    monkeypatch.setattr("karma.models.llama.answer.perf_counter", Clock())


def test_answer_that_takes_too_long_is_cut_and_at_fault(tmp_path, clocked):
    model = LlamaModel(export_tiny(tmp_path / "tiny.gguf"))
    cut = model.complete(QUESTION, max_tokens=400, max_seconds=30)
    assert cut.finish == "time"
    assert 0 < cut.completion_tokens < 30
    assert "30 s" in cut.fault
    whole = model.complete(QUESTION, max_tokens=400)
    assert (whole.finish, whole.fault) != ("time", cut.fault)
    assert whole.text.encode().startswith(cut.text.rstrip("\ufffd").encode())


def test_prompt_that_takes_too_long_to_read_is_read_on_when_asked_again(tmp_path, clocked):
    """Only the bits tell that nothing was read otherwise than in one go."""
    path = export_tiny(tmp_path / "tiny.gguf")
    long = Prompt(stable="The apple is in the fridge.\n" * 140, changing="Where is it?")
    slow, quick = (LlamaModel(path) for _ in range(2))
    assert len(slow.segments(long)[0]) > 3 * slow.gguf.n_batch
    cuts = 0
    while (said := slow.complete(long, max_tokens=5, max_seconds=3)).finish == "time":
        cuts += 1
        assert (said.completion_tokens, said.first_token_s) in ((0, None), (1, said.first_token_s))
        if said.completion_tokens:
            break
    assert cuts >= 2
    again, whole = (model.complete(long, max_tokens=5) for model in (slow, quick))
    assert again.text == whole.text
    assert slow.gguf.logits().tobytes() == quick.gguf.logits().tobytes()


def test_cut_prompt_is_not_taken_for_the_beginning_of_another(tmp_path, clocked):
    path = export_tiny(tmp_path / "tiny.gguf")
    one, other = (
        Prompt(stable=f"The {thing} is in the fridge.\n" * 140, changing="Where is it?")
        for thing in ("apple", "mug")
    )
    slow, quick = (LlamaModel(path) for _ in range(2))
    assert slow.complete(one, max_tokens=5, max_seconds=3).finish == "time"
    assert slow.complete(other, max_tokens=5).text == quick.complete(other, max_tokens=5).text
    assert slow.gguf.logits().tobytes() == quick.gguf.logits().tobytes()


def test_prompt_that_begins_like_the_last_one_is_still_read_in_its_own_batches(tmp_path):
    gguf = LlamaModel(export_tiny(tmp_path / "tiny.gguf")).gguf
    asked = []

    def in_time():
        asked.append(1)
        return False

    gguf.make_room(700)  # a context that is opened anew keeps nothing
    gguf.evaluate([[5] * 100, [6]])
    gguf.evaluate([[5] * 600, [6]], is_late=in_time)
    assert gguf.n_batch == 512
    assert len(asked) == 3  # 512 and 88 of the stable part, 1 of the other
