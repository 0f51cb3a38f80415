"""The nano VLM's training: shards, batches, a few steps, resuming, files that the adapter opens."""

import numpy as np
import pytest

from karma.contracts import SeenObject
from karma.household.types import object_types
from karma.infer.vision.processors import pictures_only
from karma.infer.vision.text import STATES, read_answer
from karma.infer.vision.transformers import TransformersVision, VisionOptions
from karma.training.vision import shards
from karma.training.vision.model import (
    FEATURES,
    VisionShape,
    answer_ids,
    new_processor,
    new_tokenizer,
    pixels,
    prompt_ids,
    save,
    words,
)
from karma.training.vision.moments import UNSEEN_PIXELS
from karma.training.vision.shards import Shard, has_shard, write_shard
from karma.training.vision.train import Crops, VisionRecipe, train, trained

TINY = VisionRecipe(
    shape=VisionShape(
        stem=8, stages=(8, 8, 8, 8), depths=(1, 1, 1, 1), tower=8, hidden=16, feed_forward=16
    ),
    shards=1, batch=4, steps=4, warmup=1, bfloat16=False,
)  # fmt: skip


@pytest.fixture(scope="module")
def crops(tmp_path_factory):
    folder = tmp_path_factory.mktemp("crops")
    with pytest.MonkeyPatch.context() as patch:
        for name, value in (("ROOMS", 1), ("STATES", 1), ("VIEWS", 4)):
            patch.setattr(shards, name, value)
        write_shard(folder, 0, seed=3, margin=1.4)
        write_shard(folder / "again", 0, seed=3, margin=1.4)
    return folder


def test_a_shard_is_the_same_bytes_twice_and_reads_back(crops):
    for name in ("0000.bin", "0000.json"):
        assert (crops / name).read_bytes() == (crops / "again" / name).read_bytes()
    assert has_shard(crops, 0)
    assert not has_shard(crops, 1)
    shard = Shard(crops, 0)
    assert len(shard.rows) > 5
    for number, row in enumerate(shard.rows):
        crop = shard.picture(number)
        assert crop.shape[0] == crop.shape[1] <= shards.LONGEST_PX
        assert set(row.states) <= set(STATES)
        assert row.pixels >= UNSEEN_PIXELS or row.states == ("none",)


def test_batches_are_drawn_by_number(crops):
    one, two = (Crops(crops, TINY, [0])[7] for _ in range(2))
    other = Crops(crops, TINY, [0])[8]
    assert (one["pixel_values"] == two["pixel_values"]).all()
    assert (one["pixel_values"] != other["pixel_values"]).any()
    assert one["pixel_values"].shape == (4, 3, 112, 112)
    parts = [Crops(crops, TINY, [0], (rank, 2))[7] for rank in range(2)]
    assert [len(part["flags"]) for part in parts] == [2, 2]


def test_all_types_and_words_are_tokens():
    tokenizer, vocabulary = new_tokenizer(), words()
    assert len(vocabulary) == len(set(vocabulary))
    for kind in object_types():
        assert vocabulary.index("<unk>") not in prompt_ids(kind)
        answer = answer_ids(kind, STATES)
        text = tokenizer.decode(answer, skip_special_tokens=True)
        thing = SeenObject(
            object_id="x", object_type=kind, position_m=(0, 0, 0), box_center_m=(0, 0, 0),
            box_size_m=(1, 1, 1), pickupable=True,
        )  # fmt: skip
        assert read_answer(text.replace(" , none", ""), [thing]).states == {
            "x": tuple(sorted(set(STATES) - {"none"}))
        }


def test_questions_of_training_are_those_of_the_processor():
    from PIL import Image

    processor = new_processor()
    crop = np.random.default_rng(0).integers(0, 255, (71, 71, 3), dtype=np.uint8)
    messages = [
        {"role": "user", "content": [{"type": "image"}, {"type": "text", "text": "ButterKnife"}]}
    ]
    text = processor.apply_chat_template(messages, add_generation_prompt=True)
    batch = processor(images=[Image.fromarray(crop)], text=[text], return_tensors="np")
    assert batch["input_ids"][0].tolist() == prompt_ids("ButterKnife")
    assert np.abs(batch["pixel_values"][0] - pixels(crop)).max() < 1e-5
    assert prompt_ids("Mug").count(words().index("<image>")) == FEATURES


def test_a_run_that_was_stopped_goes_on_to_the_same_weights(crops, tmp_path):
    from dataclasses import replace

    whole = list(train(TINY, crops, crops, tmp_path / "whole", every=2))
    list(train(replace(TINY, steps=4), crops, crops, tmp_path / "parts", every=2, stop=2))
    rest = list(train(TINY, crops, crops, tmp_path / "parts", every=2))
    assert [line.step for line in whole] == [2, 4]
    assert [line.step for line in rest] == [4]
    assert whole[-1] == rest[-1]
    one, two = (trained(TINY, tmp_path / name).state_dict() for name in ("whole", "parts"))
    assert all((one[name] == two[name]).all() for name in one)


def test_what_is_exported_opens_with_the_adapter(crops, tmp_path):
    list(train(TINY, crops, crops, tmp_path, every=4))
    save(trained(TINY, tmp_path), tmp_path / "model")
    assert pictures_only("llava").__name__ == "LlavaProcessor"
    model = TransformersVision(
        tmp_path / "model",
        options=VisionOptions(profile="compact", crop=1.4, max_tokens=8, attempts=1, threads=1),
    )
    mug = SeenObject(
        object_id="Mug|1", object_type="Mug", position_m=(0, 0, 0), box_center_m=(0, 0, 0),
        box_size_m=(1, 1, 1), pickupable=True, region=(10, 10, 60, 60),
    )  # fmt: skip
    frame = np.zeros((300, 300, 3), dtype=np.uint8)
    assert set(model.read_states(frame, "look", [mug])) <= {"Mug|1"}
    assert model.tally.asked == 1
