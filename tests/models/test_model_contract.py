"""Language models: llama.cpp over random weights made here, and the scripted one."""

import inspect
from functools import partial

import numpy as np
import pytest
from support import tiny
from support.llama_export import export_llama, random_llama

from karma.errors import ModelError
from karma.models.checks.gguf import check_gguf
from karma.models.constraint import admits, begins
from karma.models.llama.gguf_files import new_tokenizer
from karma.models.llama.model import LlamaModel
from karma.models.scripted import ScriptedModel
from karma.registry import load, names
from karma.testing import Size, make_planner
from karma.types.planning import ProgramSpec, Prompt, Skill
from karma.types.roles import Embedder, LanguageModel, ScoringModel, VisionModel

CORPUS = ["PutObject(robot, 'Apple', 'Fridge')\nThe apple is in the fridge; put it on the table.\n"]
CHAT = (
    "{% for m in messages %}<|{{ m.role }}|>{{ m.content }}<|eos|>\n{% endfor %}<|assistant|>"
)  # fmt: skip
SKILLS = (
    Skill(name="GoToObject", arguments=("object",)),
    Skill(name="PutObject", arguments=("object", "object"), optional=1),
    Skill(name="Explore", arguments=("object", "positions"), optional=1),
)
SPEC = ProgramSpec(
    skills=SKILLS, objects=("Apple", "Fridge", "Apple|-00.47|+01.15|+00.48"),
    positions=("node_1", "node_2"), max_calls=3,
)  # fmt: skip
SCENE = Prompt(
    stable="You are a robot.\nThe fridge is in the kitchen.\n" * 3, changing="Task: go.\n"
)
OTHER = Prompt(stable="Another scene, with a table.\n" * 5, changing="Task: put.\n")


def tiny_llama():
    return random_llama(420, seed=3, max_position_embeddings=512)


def export(path, *, model=None, **more):
    tokenizer = new_tokenizer(CORPUS, 420, ["<|bos|>", "<|eos|>"])
    return export_llama(model or tiny_llama(), tokenizer, path, bos="<|bos|>", **more)


@pytest.fixture(scope="module", params=["F16", "Q8_0"])
def gguf(request, tmp_path_factory):
    return export(tmp_path_factory.mktemp("m") / "tiny.gguf", dtype=request.param, template=CHAT)


@pytest.fixture(scope="module")
def model(gguf):
    return opened(gguf, threads=1)


opened = partial(tiny.opened, chat=False)


def answer(model, prompt, **options):
    return tiny.answer(model, prompt, **options)[1]


@pytest.mark.parametrize("temperature", [0.0, 0.8])
def test_warm_answer_equals_cold_to_the_bit(gguf, temperature):
    options = {"temperature": temperature, "seed": 5}
    cold = answer(opened(gguf, threads=1), SCENE, **options)
    model = opened(gguf, threads=2)
    assert answer(model, SCENE, **options) == cold
    assert answer(model, Prompt(stable=SCENE.stable, changing="What else?\n")) != cold
    assert answer(model, SCENE, **options) == cold
    answer(model, OTHER)
    assert answer(model, SCENE, **options) == cold


def test_answer_in_a_new_process_is_the_same(gguf, model):
    assert tiny.answer_elsewhere(gguf, SCENE)[1] == answer(model, SCENE)


def test_completion_counts_what_it_reused_and_cost(gguf):
    model = opened(gguf, threads=1)
    first = model.complete(SCENE, max_tokens=5)
    again = model.complete(SCENE, max_tokens=5)
    other = model.complete(OTHER, max_tokens=5)
    assert first.reused_tokens == 0 == other.reused_tokens
    assert 0 < again.reused_tokens < again.prompt_tokens == first.prompt_tokens
    assert first.completion_tokens == 5
    assert first.finish == "length"
    assert 0 < first.first_token_s <= first.total_s


def test_logits_equal_transformers_on_the_joined_prompt(tmp_path):
    import torch

    path = export(tmp_path / "f32.gguf", dtype="F32")
    tokenizer = new_tokenizer(CORPUS, 420, ["<|bos|>", "<|eos|>"])
    tokens = tokenizer.encode(SCENE.stable).ids + tokenizer.encode(SCENE.changing).ids
    with torch.no_grad():
        expected = tiny_llama()(torch.tensor([tokens])).logits[0, -1].numpy()
    model = opened(path)
    for _ in range(2):
        model.complete(SCENE, max_tokens=1)
        assert np.abs(model.gguf.logits() - expected).max() < 1e-2


@pytest.mark.parametrize("temperature", [0.0, 1.5])
@pytest.mark.parametrize("max_tokens", [3, 40, 400])
def test_constrained_answers_are_programs_however_long(model, temperature, max_tokens):
    for seed in range(4):
        found = model.complete(
            SCENE, spec=SPEC, max_tokens=max_tokens, temperature=temperature, seed=seed
        )
        assert begins(SPEC.grammar, found.text)
        assert (found.finish == "stop") is (found.fault == "")
        if found.finish == "stop":
            assert admits(SPEC.grammar, found.text)
            assert found.text.rstrip("\n").endswith(")")


def test_answer_ends_where_the_context_does(gguf):
    model = opened(gguf)
    assert model.gguf.n_ctx == model.gguf.limit == 512  # what it was trained for
    found = model.complete(Prompt(stable="", changing="Go"), max_tokens=9999)
    assert found.prompt_tokens + found.completion_tokens <= 512


@pytest.mark.parametrize("changing", ["", "T"])
def test_prompt_cut_before_its_last_token_is_answered_alike_warm_and_cold(gguf, changing):
    """One token alone is multiplied by another routine than many: here the cut shows in F16."""
    model = opened(gguf, threads=1)
    for more in range(8):  # at some lengths only
        prompt = Prompt(stable=SCENE.stable * 2 + "!\n" * more, changing=changing)
        cold, warm = (
            model.complete(prompt, max_tokens=1) and model.gguf.logits().copy() for _ in range(2)
        )
        assert np.array_equal(cold, warm)


def test_bos_is_put_in_once(tmp_path):
    plain, begun = (opened(export(tmp_path / f"{bos}.gguf", add_bos=bos)) for bos in (False, True))
    counts = [m.complete(SCENE, max_tokens=1).prompt_tokens for m in (plain, begun)]
    assert counts[1] == counts[0] + 1


def test_chat_template_is_applied_and_cut_at_the_same_place(gguf):
    chat, plain = opened(gguf, chat=True), opened(gguf)
    written = Prompt(
        stable=f"<|system|>{SCENE.stable}", changing=f"{SCENE.changing}"
    )  # the plain model takes no control tokens from text, so only the halves are compared
    before, after = chat._template.halves(SCENE)
    assert before == f"{written.stable}<|eos|>\n<|user|>"
    assert after == f"{written.changing}<|eos|>\n<|assistant|>"
    cold, warm = (chat.complete(SCENE, spec=SPEC, max_tokens=60) for _ in range(2))
    assert cold.text == warm.text
    assert warm.reused_tokens > 0
    assert cold.prompt_tokens > plain.complete(SCENE, max_tokens=1).prompt_tokens


def test_earlier_turns_are_messages_between_system_and_user(gguf):
    asked = Prompt(stable="Rules", changing="Now?", turns=(("First?", "No."), ("Then?", "Yes.")))
    before, after = opened(gguf, chat=True)._template.halves(asked)
    said = "<|eos|>\n<|user|>First?<|eos|>\n<|assistant|>No.<|eos|>\n<|user|>Then?"
    assert before == f"<|system|>Rules{said}<|eos|>\n<|assistant|>Yes.<|eos|>\n<|user|>"
    assert after.startswith("Now?")


def test_chat_without_system_role_puts_all_into_the_user_s_message(tmp_path):
    template = (
        "{% for m in messages %}{% if m.role == 'system' %}{{ raise_exception('no') }}{% endif %}"
        "[{{ m.content }}]{% endfor %}"
    )
    model = opened(export(tmp_path / "x.gguf", template=template), chat=True)
    assert model._template.halves(SCENE) == ("[" + SCENE.stable, SCENE.changing + "]")


# -------------------------------------------------------------------- files that are not right


def test_cut_off_or_foreign_file_is_a_model_error(gguf, tmp_path):
    data = gguf.read_bytes()
    path = tmp_path / "bad.gguf"
    cuts = [0, 3, 4, 20, 100, 1000, 9000, len(data) // 2, len(data) - 1]
    for content in [data[:cut] for cut in cuts] + [b"PK\3\4" + data[4:], b"\0" * 5000]:
        path.write_bytes(content)
        with pytest.raises(ModelError, match=r"bad\.gguf"):
            LlamaModel(path)


def test_file_that_makes_llama_cpp_abort_is_a_model_error(gguf, tmp_path):
    letter = b"\1" + bytes(7)  # a token of one byte
    path = tmp_path / "bad.gguf"
    path.write_bytes(gguf.read_bytes().replace(letter + b"(", letter + b")", 1))
    assert check_gguf(path)  # the header looks right: one token is there twice
    with pytest.raises(ModelError, match=r"bad\.gguf: llama\.cpp cannot run it \(code -6\)"):
        LlamaModel(path)


@pytest.fixture(scope="module")
def long(tmp_path_factory):
    """A planner that was trained for more tokens than it is opened with."""
    size = Size(width=64, feed_forward=128, vocabulary=600, context=5000, tied=True)
    return make_planner(tmp_path_factory.mktemp("long") / "long.gguf", size=size)


def test_context_grows_with_the_prompt_and_changes_no_bit(long):
    grown, whole = opened(long, threads=1), opened(long, threads=1, n_ctx=4096)
    prompts = [
        Prompt(stable="#areas\nnode_1 Fridge Sink\n" * times, changing="#task go\n#program\n")
        for times in (2, 40, 80, 3, 40)
    ]
    sizes = []
    for prompt in prompts:
        assert answer(grown, prompt)[1] == answer(whole, prompt)[1]
        assert answer(grown, prompt) == answer(whole, prompt)
        sizes.append(grown.gguf.engine.n_ctx)
    assert sizes == sorted(sizes)
    assert sizes[0] == 512 < sizes[1] < sizes[2] <= 4096
    assert whole.gguf.engine.n_ctx == 4096


def test_model_that_was_closed_fails_in_python_and_closing_again_does_nothing(gguf):
    model = opened(gguf)
    model.close()
    model.close()
    with pytest.raises(AttributeError):
        model.complete(SCENE)


@pytest.mark.parametrize("spec", [None, SPEC])
@pytest.mark.parametrize("temperature", [0.0, 1.0])
def test_damaged_weights_are_a_model_error_not_an_answer(tmp_path, spec, temperature):
    weights = tiny_llama()
    weights.model.norm.weight.data[:] = np.nan
    export(tmp_path / "nan.gguf", model=weights)
    with pytest.raises(ModelError, match="best score of a token is nan: damaged weights"):
        opened(tmp_path / "nan.gguf").complete(SCENE, spec=spec, temperature=temperature)


# ------------------------------------------------------------------------------ the other models


@pytest.mark.parametrize(("role", "contract"), [
    ("language_models", LanguageModel), ("vision_models", VisionModel), ("embedders", Embedder),
])  # fmt: skip
def test_every_registered_model_has_the_contract_s_methods(role, contract):
    assert names(role)
    for name in names(role):
        found = load(role, name)
        for method, told in inspect.getmembers(contract, inspect.isfunction):
            if not method.startswith("_"):
                ours = inspect.signature(getattr(found, method)).parameters
                assert list(ours) == list(inspect.signature(told).parameters), (name, method)


@pytest.mark.parametrize("name", names("language_models"))
def test_every_language_model_but_a_hosted_one_chooses_as_the_contract_says(name):
    ours = getattr(load("language_models", name), "choose", None)
    assert (ours is None) == (name == "openai")
    if ours is not None:
        told = inspect.signature(ScoringModel.choose).parameters
        assert list(inspect.signature(ours).parameters) == list(told)


@pytest.mark.parametrize("name", names("vision_models"))
def test_every_vision_model_says_whether_it_needs_pictures(name):
    assert load("vision_models", name).needs_pictures is (name not in ("blind", "metadata"))


def test_scripted_model_says_its_script_and_then_fails():
    model = ScriptedModel(["a b", "c"])
    assert [model.complete(SCENE, spec=SPEC).text, model.complete(OTHER).text] == ["a b", "c"]
    assert model.prompts == [SCENE, OTHER]
    assert model.specs == [SPEC, None]
    with pytest.raises(ModelError, match="run out: 2 answers"):
        model.complete(SCENE)
