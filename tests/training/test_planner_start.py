"""Beginning with a GGUF, several processes, and the schedule of the learning rate."""

import copy
from dataclasses import replace

import pytest
import torch
from support.paths import ROOT

from karma.files import to_json
from karma.infer.llama.gguf_import import fill_from_gguf, read_gguf_tokenizer
from karma.tasks.drawing.phrases import our_book
from karma.tasks.drawing.rooms import room_of
from karma.training.planner import checkpoints, network, packs, ranks, start, train
from karma.training.planner.start import extended_tokenizer, started_model
from karma.world.core import scene

START = ROOT / "models" / "nano" / "start.gguf"
RECIPE = packs.PlannerRecipe(
    vocabulary=480, hidden=32, layers=2, heads=2, feed_forward=48, packs=4, examples=2,
    steps=3, warmup=1, decay=1,
)  # fmt: skip


@pytest.fixture(scope="module")
def data():
    rooms = [room_of(scene.load(name), name) for name in ("kitchen_1", "living_1")]
    return packs.Data(rooms=rooms, book=our_book().part(held_out=False))


@pytest.fixture(scope="module")
def started():
    tokenizer = extended_tokenizer(START)
    recipe = packs.PlannerRecipe(vocabulary=tokenizer.get_vocab_size())
    return tokenizer, started_model(recipe, tokenizer, START)


def test_prompts_without_new_notation_tokenise_as_the_start_has_them(data, started):
    old = read_gguf_tokenizer(START)
    new = set(packs.WHOLE) - set(old.get_vocab())
    for number in range(40):
        for example in packs.draw_pack(RECIPE, data, "old", str(number)):
            text = example.stable + example.changing + example.program
            if not any(piece in text for piece in new):
                assert started[0].encode(text).ids == old.encode(text).ids


def test_new_notation_is_one_token_each_after_the_old_ones(monkeypatch):
    new = ("#weather ", "ask('")
    monkeypatch.setattr(start, "WHOLE", (*packs.WHOLE, *new))
    tokenizer = extended_tokenizer(START)
    recipe = packs.PlannerRecipe(vocabulary=tokenizer.get_vocab_size())
    model = started_model(recipe, tokenizer, START)
    old = read_gguf_tokenizer(START).get_vocab_size()
    for text in new:
        ids = tokenizer.encode(text, add_special_tokens=False).ids
        assert len(ids) == 1
        assert ids[0] >= old
        assert model.model.embed_tokens.weight[ids[0]].abs().sum() > 0


def test_exported_weights_are_mixed_with_those_of_the_start(started, tmp_path):
    tokenizer, model = started
    recipe = packs.PlannerRecipe(
        vocabulary=tokenizer.get_vocab_size(), start="nano/start.gguf", kept=0.25
    )
    moved = copy.deepcopy(model)
    with torch.no_grad():
        for value in moved.parameters():
            value += 1
    (tmp_path / "recipe.json").write_bytes(to_json(recipe))
    (tmp_path / "tokenizer.json").write_text(tokenizer.to_str())
    checkpoints.save_checkpoint(tmp_path, moved, copy.deepcopy(moved), (), step=1, tokens=1)
    path = tmp_path / "x.gguf"
    checkpoints.export_gguf(tmp_path, path, "F32", models=ROOT / "models")
    found = network.new_model(recipe)
    fill_from_gguf(found, path)
    for one, first in zip(found.parameters(), model.parameters(), strict=True):
        assert torch.allclose(one, first + 0.75, atol=1e-5)


def test_first_log_probabilities_are_those_of_the_start(data, started):
    """Of the old tokens, as llama.cpp computes them from the file."""
    import llama_cpp
    import numpy as np

    tokenizer, model = started
    example = packs.draw_pack(RECIPE, data, "logits")[0]
    ids = tokenizer.encode(example.stable + example.changing, add_special_tokens=False).ids
    file = llama_cpp.Llama(str(START), n_ctx=512, n_threads=1, logits_all=True, verbose=False)
    file.eval(ids)
    theirs = np.array(file.scores[len(ids) - 1])
    with torch.no_grad():
        ours = model(torch.tensor([ids])).logits[0, -1].numpy()[: len(theirs)]
    assert np.abs(ours - theirs).max() < 0.1 * np.abs(theirs).max()
    assert ours.argmax() == theirs.argmax()


def test_rate_rises_stays_and_falls_however_long_it_stays():
    recipe = replace(RECIPE, steps=100, warmup=10, decay=20)
    shares = [train.rate_share(recipe, step) for step in range(100)]
    assert shares[:10] == pytest.approx([(n + 1) / 10 for n in range(10)])
    assert set(shares[10:81]) == {1.0}
    assert shares[80:] == pytest.approx([n / 20 for n in range(20, 0, -1)])
    longer = replace(recipe, steps=1000)
    assert [train.rate_share(longer, step) for step in range(80)] == shares[:80]


def train_share(rank, number, meeting, recipe, data, folder):
    """Train as one of several processes; for `torch.multiprocessing.spawn`."""
    import torch

    torch.distributed.init_process_group(
        "gloo", init_method=f"file://{meeting}", rank=rank, world_size=number
    )
    tokenizer = extended_tokenizer(START)
    held_out = [packs.draw_pack(recipe, data, "held-out")]
    list(train.train(recipe, data, held_out, tokenizer, folder, share=(rank, number)))


def test_step_of_two_processes_is_the_step_on_the_mean_of_their_gradients(data, tmp_path):
    import torch
    from safetensors.torch import load_file
    from torch.nn.functional import cross_entropy

    tokenizer = extended_tokenizer(START)
    recipe = replace(RECIPE, vocabulary=tokenizer.get_vocab_size(), steps=1)
    torch.multiprocessing.spawn(
        train_share, (2, tmp_path / "meeting", recipe, data, tmp_path), nprocs=2
    )
    model = network.new_model(recipe)
    for rank in (0, 1):
        drawn = [packs.draw_pack(recipe, data, "train", "0", str(n)) for n in range(rank, 4, 2)]
        logits, targets = network.forward(model, network.collate(drawn, tokenizer))
        (cross_entropy(logits, targets) / 2).backward()
    torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
    optimizers = train._optimizers(model, recipe)
    for one in optimizers:
        one.step()
    found = load_file(tmp_path / "checkpoint.safetensors")
    for name, value in model.named_parameters():
        assert torch.allclose(found[f"model.{name}"], value, atol=1e-4), name
    for value in ranks.matrices(optimizers[0]):
        name = next(name for name, one in model.named_parameters() if one is value)
        momentum = optimizers[0].state[value]["momentum_buffer"]
        assert torch.allclose(found[f"momentum_buffer.{name}"], momentum, atol=1e-5), name


def test_several_groups_of_requests_are_told_apart(data):
    pack = packs.draw_pack(RECIPE, data, "groups")
    refused = replace(pack[0], kind="refuse_deed")
    hinted = replace(pack[0], changing="#task x\n#words y: Mug 8\n#program\n", kind="place")
    found = train.by_group([[refused, hinted]])
    assert found == {"all": [[refused, hinted]], "refused": [[refused]], "hinted": [[hinted]]}
