"""The nano VLM before training: a LLaVA with a small DPT-hybrid tower and a small Llama; its files.

The tower is a ResNet whose 4 x 4 last features go through a transformer layer (DPT's "hybrid"
embedding): on rendered rooms convolutions learn several times faster than patches or LeViT do.
All weights are drawn from a seed. Tokens are whole words: names of types, the twelve state words,
three signs.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import numpy as np

from karma.contracts import State
from karma.household.pieces import base_type
from karma.household.types import object_types

SIZE_PX = 112
ACROSS = 4  # features along a side
FEATURES = ACROSS**2  # image tokens
MEAN, STD = 0.5, 0.25
PAD, END, UNKNOWN, IMAGE = "<pad>", "</s>", "<unk>", "<image>"
TEMPLATE = (
    "{% for message in messages %}{% for part in message['content'] %}"
    "{% if part['type'] == 'image' %}<image>{% else %}{{ part['text'] }}{% endif %}"
    "{% endfor %}{% endfor %}{% if add_generation_prompt %}{{ '\\n' }}{% endif %}"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class VisionShape:
    """Sizes of the network."""

    stem: int = 32
    stages: tuple[int, int, int, int] = (40, 80, 160, 256)
    depths: tuple[int, int, int, int] = (1, 2, 2, 1)
    tower: int = 192
    tower_layers: int = 1
    hidden: int = 192
    layers: int = 2
    feed_forward: int = 512


def words() -> list[str]:
    """Return the vocabulary, in the order of the tokens' numbers."""
    names = sorted({base_type(name) for name in object_types()})
    states = list(dict.fromkeys(word for state in get_args(State) for word in state.split()))
    return [PAD, END, UNKNOWN, IMAGE, ":", ",", "\n", *states, *names]


def new_tokenizer() -> Any:
    """Return a tokenizer of whole words."""
    from tokenizers import Regex, Tokenizer
    from tokenizers.models import WordLevel
    from tokenizers.pre_tokenizers import Split
    from transformers import PreTrainedTokenizerFast

    bare = Tokenizer(WordLevel({word: i for i, word in enumerate(words())}, unk_token=UNKNOWN))
    bare.pre_tokenizer = Split(Regex(r"[A-Za-z0-9]+|[:,\n]"), "removed", invert=True)
    return PreTrainedTokenizerFast(
        tokenizer_object=bare,
        pad_token=PAD,
        eos_token=END,
        unk_token=UNKNOWN,
        additional_special_tokens=[IMAGE],
        extra_special_tokens={"image_token": IMAGE},
        padding_side="left",
        clean_up_tokenization_spaces=False,
    )


def new_processor() -> Any:
    """Return the processor: pictures to 112 x 112, the chat template, the tokenizer."""
    from transformers import LlavaProcessor
    from transformers.models.llava.image_processing_pil_llava import LlavaImageProcessorPil

    pictures = LlavaImageProcessorPil(
        do_pad=False,
        do_resize=True,
        size={"height": SIZE_PX, "width": SIZE_PX},
        resample=2,
        do_center_crop=False,
        do_rescale=True,
        do_normalize=True,
        image_mean=[MEAN] * 3,
        image_std=[STD] * 3,
        do_convert_rgb=True,
    )
    return LlavaProcessor(
        image_processor=pictures,
        tokenizer=new_tokenizer(),
        patch_size=SIZE_PX // ACROSS,
        vision_feature_select_strategy="default",
        chat_template=TEMPLATE,
        num_additional_image_tokens=1,
    )


def new_model(shape: VisionShape, seed: int) -> Any:
    """Return the network with random weights drawn from a seed."""
    import torch
    from transformers import (
        DPTConfig,
        LlamaConfig,
        LlavaConfig,
        LlavaForConditionalGeneration,
        ResNetConfig,
    )

    vocabulary = words()
    backbone = ResNetConfig(
        embedding_size=shape.stem,
        hidden_sizes=list(shape.stages),
        depths=list(shape.depths),
        layer_type="basic",
        out_features=["stage2", "stage3", "stage4"],
    )
    tower = DPTConfig(
        is_hybrid=True,
        backbone_config=backbone,
        backbone_featmap_shape=[1, shape.stages[-1], ACROSS, ACROSS],
        image_size=SIZE_PX,
        patch_size=SIZE_PX // ACROSS,
        hidden_size=shape.tower,
        num_hidden_layers=shape.tower_layers,
        num_attention_heads=4,
        intermediate_size=2 * shape.tower,
    )
    text = LlamaConfig(
        vocab_size=len(vocabulary),
        hidden_size=shape.hidden,
        intermediate_size=shape.feed_forward,
        num_hidden_layers=shape.layers,
        num_attention_heads=4,
        num_key_value_heads=4,
        max_position_embeddings=256,
        bos_token_id=None,
        eos_token_id=vocabulary.index(END),
        pad_token_id=vocabulary.index(PAD),
    )
    config = LlavaConfig(
        vision_config=tower,
        text_config=text,
        image_token_index=vocabulary.index(IMAGE),
        vision_feature_layer=-1,
        vision_feature_select_strategy="default",
        image_seq_length=FEATURES,
        pad_token_id=vocabulary.index(PAD),
        eos_token_id=vocabulary.index(END),
    )
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        return LlavaForConditionalGeneration(config)


def save(model: Any, folder: Path) -> None:
    """Write weights (half precision), configuration, tokenizer and processor into a folder."""
    import torch

    folder.mkdir(parents=True, exist_ok=True)
    model.to(torch.float16).save_pretrained(folder)
    new_processor().save_pretrained(folder)


def prompt_ids(kind: str) -> list[int]:
    """Return the tokens of a question as the processor makes them."""
    place = {word: i for i, word in enumerate(words())}
    name = place.get(base_type(kind), place[UNKNOWN])
    return [place[IMAGE]] * FEATURES + [name, place["\n"]]


def answer_ids(kind: str, states: Sequence[str]) -> list[int]:
    """Return the tokens of a true answer, `Mug: dirty, filled` and the end."""
    place = {word: i for i, word in enumerate(words())}
    found = [place.get(base_type(kind), place[UNKNOWN]), place[":"]]
    for number, state in enumerate(states):
        found += [place[","]] if number else []
        found += [place[word] for word in state.split()]
    return [*found, place[END]]


def pixels(crop: np.ndarray, box: tuple[float, float, float, float] | None = None) -> np.ndarray:
    """Return what the tower sees of a crop, or of a part of it: float32 (3, 112, 112)."""
    from PIL import Image

    picture = Image.fromarray(crop)
    small = picture.resize((SIZE_PX, SIZE_PX), Image.Resampling.BILINEAR, box=box)
    return ((np.asarray(small, dtype=np.float32) / 255 - MEAN) / STD).transpose(2, 0, 1)
