"""Tuning a GGUF: training's tokens are llama.cpp's, and the adapter's file is what peft says."""

import json
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.tiny import export_tiny, opened

from karma.errors import FileError, ModelError
from karma.models.llama.gguf_files import merge_adapter
from karma.models.llama.gguf_model import GgufModel
from karma.models.llama.opening import LlamaOptions
from karma.plugins.training.tuning import (
    ADAPTER,
    ADAPTER_CONFIG,
    EncodedExample,
    TuningRecipe,
    base_model,
    batches_of,
    collate,
    encode,
    read_chats,
    tune,
    tune_file,
)
from karma.testing import Size, make_planner
from karma.types.planning import Prompt


def chat(*texts, weights=()):
    """A line with these messages; the first is the system's."""
    roles = ("system", *("user", "assistant") * len(texts))
    messages = [{"role": role, "content": text} for role, text in zip(roles, texts, strict=False)]
    for message, weight in zip(messages[2::2], weights, strict=False):
        message["weight"] = weight
    return {"messages": messages}


LINES = [
    chat("#areas\nunknown\n", f"#task get the {name.lower()}\n#memory\n#program\n",
         f"GoToObject(robot, '{name}')\nPickupObject(robot, '{name}')\n")
    for name in ("Apple", "ButterKnife", "CellPhone", "Mug_2", "Plate")
]  # fmt: skip
TALK = chat("You are a robot.\nSink, Fridge\n", "Request: open the fridge", "open(Frige)",
            "open(Frige) -> FAILED", "open(Fridge)", "open(Fridge) -> ok", 'done("It is open.")',
            weights=(0, 1))  # fmt: skip


def example(tokens, prompt):
    """An example of a single answer."""
    return EncodedExample(tokens=tuple(tokens), answers=((prompt, len(tokens)),))


def examples_file(folder, lines):
    path = folder / "examples.jsonl"
    path.write_text("".join(f"{json.dumps(line)}\n" for line in lines))
    return path


@pytest.mark.parametrize(
    "line",
    [
        {"prompt": ["one", "text"], "answer": "x"},
        chat("system"),
        chat("system", "user"),
        {"messages": [{"role": "assistant", "content": "x"}]},
        {"messages": "text"},
    ],
)
def test_what_is_no_chat_is_refused_with_its_line(tmp_path, line):
    path = examples_file(tmp_path, [LINES[0], line])
    with pytest.raises(FileError, match="line 2 is no"):
        list(read_chats(path))


@pytest.fixture(scope="module")
def qwen(tmp_path_factory):
    """A file of random weights with the architecture and chat template of Qwen 2.5."""
    size = Size(feed_forward=64)
    return make_planner(tmp_path_factory.mktemp("chat") / "tiny.gguf", "qwen2.5", size=size)


def test_tokens_before_each_answer_are_those_of_the_prompt_at_inference(tmp_path, qwen):
    model = opened(qwen)
    (encoded,) = encode(read_chats(examples_file(tmp_path, [TALK])), model)
    texts = [message["content"] for message in TALK["messages"]]
    stable, users, answers = texts[0], texts[1::2], texts[2::2]
    spans = encoded.answers
    assert len(spans) == 2  # that of no weight is left out
    for number, (start, stop) in enumerate(spans, start=1):
        turns = tuple(zip(users[:number], answers[:number], strict=True))
        prompt = Prompt(stable=stable, turns=turns, changing=users[number])
        segments = model.segments(prompt)
        assert encoded.tokens[:start] == tuple(token for one in segments for token in one)
        end = (*model.gguf.tokens(answers[number]), model.gguf.end_token)
        assert encoded.tokens[start:stop] == end


def test_chat_whose_template_rewrites_answers_is_an_example_for_each(tmp_path):
    model = opened(make_planner(tmp_path / "thinking.gguf", "qwen3"))
    thinking = chat("You are a robot.", "open it", "<think>\nit\n</think>\nopen(Fridge)", "ok",
                    'done("Yes.")')  # fmt: skip
    found = list(encode(read_chats(examples_file(tmp_path, [thinking])), model))
    assert [len(one.answers) for one in found] == [1, 1]


@given(
    st.lists(st.tuples(st.integers(1, 40), st.integers(1, 40)), min_size=1, max_size=60),
    st.integers(1, 200),
)
def test_batches_hold_every_example_once_and_no_more_than_they_may(sizes, most):
    examples = [example(range(prompt + rest), prompt) for prompt, rest in sizes]
    batches = batches_of(examples, most, 0)
    assert sorted(len(one.tokens) for batch in batches for one in batch) == sorted(
        len(one.tokens) for one in examples
    )
    for batch in batches:
        assert len(batch) == 1 or len(batch) * max(len(one.tokens) for one in batch) <= most


def test_the_loss_counts_answers_alone():
    batch = [example((5, 6, 7, 2), 2), example((8, 2), 1)]
    given = collate(batch)
    assert given["input_ids"].tolist() == [[5, 6, 7, 2], [8, 2, 0, 0]]
    assert given["labels"].tolist() == [[-100, -100, 7, 2], [-100, 2, -100, -100]]
    later = collate([example((5, 6, 7, 8, 2), 3)])
    assert later["labels"].tolist() == [[-100, 8, 2]]
    assert later["logits_to_keep"].tolist() == [2, 3, 4]
    turns = collate([EncodedExample(tokens=(5, 6, 2, 7, 8, 2), answers=((1, 3), (5, 6)))])
    assert turns["labels"].tolist() == [[-100, 6, 2, -100, -100, 2]]


@pytest.fixture(scope="module")
def base(tmp_path_factory):
    """A file of random weights, rounded as the real ones are."""
    return export_tiny(tmp_path_factory.mktemp("base") / "tiny.gguf", dtype="Q8_0", layers=2)


@pytest.fixture(scope="module")
def weights(base):
    """The same for training: for copies."""
    return base_model(base)


def test_leaving_out_the_prompts_logits_changes_no_loss(weights):
    import torch

    batch = [
        example(range(100, 112), 6),
        example((*range(50, 58), 2), 7),
    ]
    given, model = collate(batch), deepcopy(weights).eval()
    labels = torch.full(given["input_ids"].shape, -100)
    labels[:, -given["labels"].shape[1] :] = given["labels"]
    with torch.no_grad():
        short = model(**given)
        whole = model(input_ids=given["input_ids"], labels=labels)
    assert short.logits.shape[1] == 7 < whole.logits.shape[1]
    assert abs(float(short.loss) - float(whole.loss)) < 1e-5


@pytest.fixture(scope="module")
def tuned(tmp_path_factory, base, weights):
    """An adapter of a few steps: enough to be told from rounding."""
    pytest.importorskip("peft")
    folder = tmp_path_factory.mktemp("tuned")
    given = list(encode(read_chats(examples_file(folder, LINES)), opened(base)))
    recipe = TuningRecipe(rank=2, alpha=4, steps=6, warmup=0, tokens=512, rate=2e-2)
    found = tune(deepcopy(weights), batches_of(given, 512, 0), folder, recipe,
                 watched=[given[:2]])  # fmt: skip
    assert 0 <= found["exact"] <= 1
    return folder


def test_tuning_on_chats_stops_in_time_and_resumes(tmp_path, qwen):
    pytest.importorskip("peft")
    path = examples_file(tmp_path, [TALK] * 6)
    recipe = TuningRecipe(rank=2, alpha=4, steps=3, warmup=0, tokens=256, minutes=1e-6)
    tune_file(qwen, path, tmp_path / "out", recipe)
    assert [one.name for one in (tmp_path / "out").glob("checkpoint-*")] == ["checkpoint-1"]
    found = tune_file(qwen, path, tmp_path / "out", replace(recipe, minutes=0), watched=path)
    assert {"loss", "exact"} < found.keys()
    assert [one.name for one in (tmp_path / "out").glob("checkpoint-*")] == ["checkpoint-3"]
    made = tmp_path / "tuned.gguf"
    files = (tmp_path / "out" / ADAPTER, tmp_path / "out" / ADAPTER_CONFIG)
    merge_adapter(qwen, *files, made, name="tuned", keeps_template=True)
    assert opened(made).manner == "through its own chat template"


def test_a_merged_file_says_what_base_and_adapter_say_together(tmp_path, base, weights, tuned):
    import torch
    from peft import PeftModel

    files = (tuned / ADAPTER, tuned / ADAPTER_CONFIG)
    merge_adapter(base, *files, tmp_path / "one.gguf", name="tuned")
    model = GgufModel(tmp_path / "one.gguf", LlamaOptions(threads=1))
    plain = GgufModel(base, LlamaOptions(threads=1))
    tokens = model.tokens("#task get the apple\n#program\nGoToObject(robot, '")
    adapted = PeftModel.from_pretrained(deepcopy(weights), str(tuned)).eval()
    with torch.no_grad():
        wanted = adapted(torch.tensor([tokens])).logits[0, -1].numpy()
        with adapted.disable_adapter():
            before = adapted(torch.tensor([tokens])).logits[0, -1].numpy()
    found = []
    for each in (model, plain):
        each.evaluate([tokens])
        found.append(each.logits().copy())
    moved, quantised = np.abs(wanted - before).max(), np.abs(found[1] - before).max()
    assert np.abs(found[0] - wanted).max() < 2 * quantised < moved * 2
    assert np.corrcoef(found[0] - found[1], wanted - before)[0, 1] > 0.9
    assert "tokenizer.chat_template" not in model.metadata


def test_what_cannot_be_merged_is_refused(tmp_path, base, tuned):
    config = json.loads((tuned / ADAPTER_CONFIG).read_text())
    other = tmp_path / "config.json"
    other.write_text(json.dumps(config | {"use_dora": True}))
    with pytest.raises(ModelError, match="DoRA"):
        merge_adapter(base, tuned / ADAPTER, other, tmp_path / "no.gguf", name="no")
    other = make_planner(tmp_path / "other.gguf", "qwen2.5")
    with pytest.raises(ModelError, match=r"has no place|the adapter"):
        merge_adapter(other, tuned / ADAPTER, tuned / ADAPTER_CONFIG,
                      tmp_path / "no.gguf", name="no")  # fmt: skip
    torn = tmp_path / "torn.safetensors"
    torn.write_bytes((tuned / ADAPTER).read_bytes()[:100])
    with pytest.raises(FileError, match="no adapter"):
        merge_adapter(base, torn, tuned / ADAPTER_CONFIG, tmp_path / "no.gguf", name="no")
    assert not (tmp_path / "no.gguf").exists()
