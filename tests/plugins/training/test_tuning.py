"""Tuning a GGUF: training's tokens are llama.cpp's, and the adapter's file is what peft says."""

import json
from copy import deepcopy

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.paths import ROOT
from support.tiny import export_tiny

from karma.errors import FileError, ModelError
from karma.goals.files import load_texts
from karma.household.types import object_types
from karma.models.llama.gguf_files import merge_adapter
from karma.models.llama.gguf_model import GgufModel
from karma.models.llama.opening import LlamaOptions
from karma.plugins.training.gguf_tokenizer import read_gguf_tokenizer
from karma.plugins.training.tuning import (
    ADAPTER,
    ADAPTER_CONFIG,
    EncodedExample,
    TuningRecipe,
    base_model,
    batches_of,
    collate,
    encode,
    end_token,
    read_examples,
    tune,
)
from karma.testing import make_planner

LINES = [
    {"prompt": ["#areas\nunknown\n", f"#task get the {name.lower()}\n#memory\n#program\n"],
     "answer": f"GoToObject(robot, '{name}')\nPickupObject(robot, '{name}')\n"}
    for name in ("Apple", "ButterKnife", "CellPhone", "Mug_2", "Plate")
]  # fmt: skip


def examples_file(folder, lines):
    path = folder / "examples.jsonl"
    path.write_text("".join(f"{json.dumps(line)}\n" for line in lines))
    return path


def test_tokens_are_those_of_llama_cpp_for_all_that_is_written_and_named(smollm):
    tokenizer = read_gguf_tokenizer(smollm)
    model = GgufModel(smollm, LlamaOptions(threads=1))
    texts = [*load_texts(ROOT / "eval" / "requests" / "written.jsonl"), *object_types()]
    texts += ["#areas\nnode_12 Fridge\n", " @Fridge cleaned *Apple_2\n", "a  b\n\n 12 34\n", "é 猫"]
    for text in texts:
        assert tokenizer.encode(text).ids == model.tokens(text), text


def test_a_name_goes_on_in_the_same_tokens_wherever_a_token_ends(smollm):
    """The decoder puts names whole, training has them in lines: both must be cut alike."""
    tokenizer = read_gguf_tokenizer(smollm)
    for name in object_types():
        whole = tokenizer.encode(f"PutObject(robot, '{name}')\n").ids
        before = tokenizer.encode("PutObject(robot, '").ids
        assert whole == [*before, *tokenizer.encode(f"{name}')\n").ids], name


def test_what_is_no_example_is_refused_with_its_line(tmp_path):
    path = examples_file(tmp_path, [LINES[0], {"prompt": "one text", "answer": "x"}])
    with pytest.raises(FileError, match="line 2 is no"):
        list(read_examples(path))


@given(
    st.lists(st.tuples(st.integers(1, 40), st.integers(1, 40)), min_size=1, max_size=60),
    st.integers(1, 200),
)
def test_batches_hold_every_example_once_and_no_more_than_they_may(sizes, most):
    examples = [
        EncodedExample(tokens=tuple(range(prompt + rest)), prompt=prompt) for prompt, rest in sizes
    ]
    batches = batches_of(examples, most, 0)
    assert sorted(len(one.tokens) for batch in batches for one in batch) == sorted(
        len(one.tokens) for one in examples
    )
    for batch in batches:
        assert len(batch) == 1 or len(batch) * max(len(one.tokens) for one in batch) <= most


def test_the_loss_counts_answers_alone():
    batch = [EncodedExample(tokens=(5, 6, 7, 2), prompt=2), EncodedExample(tokens=(8, 2), prompt=1)]
    given = collate(batch)
    assert given["input_ids"].tolist() == [[5, 6, 7, 2], [8, 2, 0, 0]]
    assert given["labels"].tolist() == [[-100, -100, 7, 2], [-100, 2, -100, -100]]
    later = collate([EncodedExample(tokens=(5, 6, 7, 8, 2), prompt=3)])
    assert later["labels"].tolist() == [[-100, 8, 2]]
    assert later["logits_to_keep"].tolist() == [2, 3, 4]


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
        EncodedExample(tokens=tuple(range(100, 112)), prompt=6),
        EncodedExample(tokens=(*range(50, 58), 2), prompt=7),
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
    tokenizer = read_gguf_tokenizer(base)
    given = encode(read_examples(examples_file(folder, LINES)), tokenizer, end_token(base))
    recipe = TuningRecipe(rank=2, alpha=4, steps=6, warmup=0, tokens=512, rate=2e-2)
    found = tune(deepcopy(weights), batches_of(given, 512, 0), folder, recipe,
                 watched=[given[:2]])  # fmt: skip
    assert 0 <= found["exact"] <= 1
    return folder


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
