"""Vision models of random weights in a few hundred kB: each family's own architecture and files."""

from karma.models.picture_questions import STATES, question

TEMPLATE = (
    "{% for message in messages %}{{ message['role'] }}: {% for part in message['content'] %}"
    "{% if part['type'] == 'image' %}PICTURE{% else %}{{ part['text'] }}{% endif %}"
    "{% endfor %}\n{% endfor %}{% if add_generation_prompt %}assistant: {% endif %}"
)
SPECIAL = {
    "llava": ["<image>"],
    "qwen2_5_vl": ["<|vision_start|>", "<|image_pad|>", "<|vision_end|>", "<|video_pad|>"],
    "smolvlm": ["<fake_token_around_image>", "<image>", "<end_of_utterance>", "<global-img>"],
}
SPECIAL["idefics3"] = SPECIAL["smolvlm"]
PICTURE = {
    "llava": "<image>",
    "qwen2_5_vl": "<|vision_start|><|image_pad|><|vision_end|>",
    "smolvlm": "<image>",
    "idefics3": "<image>",
}
FAMILIES = tuple(SPECIAL)
TEXT = {
    "hidden_size": 32, "intermediate_size": 64, "num_hidden_layers": 1, "num_attention_heads": 2,
    "num_key_value_heads": 2, "max_position_embeddings": 4096,
}  # fmt: skip


def save_family(family, folder):
    """Write a model of that family with its processor; the files are those of a real one."""
    import torch

    tokenizer = _tokenizer(family)
    processor = _processor(family, tokenizer)
    torch.manual_seed(5)
    model = _model(family, tokenizer)
    model.save_pretrained(folder)
    tokenizer.save_pretrained(folder)
    processor.image_processor.save_pretrained(folder)
    processor.save_pretrained(folder)
    return folder


def _tokenizer(family):
    from tokenizers import Tokenizer, decoders, models, pre_tokenizers, trainers
    from transformers import PreTrainedTokenizerFast

    bare = Tokenizer(models.BPE())
    bare.pre_tokenizer = pre_tokenizers.ByteLevel(add_prefix_space=False)
    bare.decoder = decoders.ByteLevel()
    trainer = trainers.BpeTrainer(
        vocab_size=400,
        special_tokens=["<pad>", "</s>", *SPECIAL[family]],
        initial_alphabet=pre_tokenizers.ByteLevel.alphabet(),
        show_progress=False,
    )
    bare.train_from_iterator([*question("full", "wash the mug", []), ", ".join(STATES)], trainer)
    return PreTrainedTokenizerFast(
        tokenizer_object=bare,
        pad_token="<pad>",
        eos_token="</s>",
        additional_special_tokens=SPECIAL[family],
        extra_special_tokens={"image_token": "<image>"} if family == "llava" else {},
    )


def _processor(family, tokenizer):
    import transformers

    from karma.plugins.vision.vlm import pictures_only

    template = TEMPLATE.replace("PICTURE", PICTURE[family])
    kind = pictures_only(family)
    if family == "llava":
        pictures = transformers.models.llava.image_processing_pil_llava.LlavaImageProcessorPil(
            size={"height": 32, "width": 32}, do_center_crop=False, do_pad=False
        )
        more = {"patch_size": 8, "vision_feature_select_strategy": "default",
                "num_additional_image_tokens": 1}  # fmt: skip
    elif family == "qwen2_5_vl":
        pictures = (
            transformers.models.qwen2_vl.image_processing_pil_qwen2_vl.Qwen2VLImageProcessorPil(
                min_pixels=28 * 28, max_pixels=56 * 56
            )
        )
        more = {}
    else:
        where = transformers.models.idefics3.image_processing_pil_idefics3
        pictures = where.Idefics3ImageProcessorPil(
            size={"longest_edge": 32}, max_image_size={"longest_edge": 32}, do_image_splitting=False
        )
        more = {"image_seq_len": 4}
    return kind(image_processor=pictures, tokenizer=tokenizer, chat_template=template, **more)


def _model(family, tokenizer):
    import transformers as t

    place = tokenizer.convert_tokens_to_ids
    ends = {"pad_token_id": 0, "eos_token_id": 1, "bos_token_id": None}
    text = {**TEXT, "vocab_size": len(tokenizer), **ends}
    small = {"hidden_size": 32, "intermediate_size": 64, "num_hidden_layers": 2,
             "num_attention_heads": 2, "image_size": 32, "patch_size": 8}  # fmt: skip
    if family == "llava":
        config = t.LlavaConfig(
            vision_config=t.CLIPVisionConfig(**small), text_config=t.LlamaConfig(**text),
            image_token_index=place("<image>"), **ends,
        )  # fmt: skip
        return t.LlavaForConditionalGeneration(config)
    if family == "qwen2_5_vl":
        config = t.Qwen2_5_VLConfig(
            text_config={**text, "rope_scaling": {"type": "mrope", "mrope_section": [2, 3, 3]}},
            vision_config={"depth": 1, "hidden_size": 32, "intermediate_size": 64, "num_heads": 2,
                           "out_hidden_size": 32, "fullatt_block_indexes": [0]},
            image_token_id=place("<|image_pad|>"), video_token_id=place("<|video_pad|>"),
            vision_start_token_id=place("<|vision_start|>"),
            vision_end_token_id=place("<|vision_end|>"), **ends,
        )  # fmt: skip
        return t.Qwen2_5_VLForConditionalGeneration(config)
    configs = {"smolvlm": (t.SmolVLMConfig, t.SmolVLMForConditionalGeneration),
               "idefics3": (t.Idefics3Config, t.Idefics3ForConditionalGeneration)}  # fmt: skip
    config, model = configs[family]
    return model(
        config(
            vision_config=small,
            text_config={"model_type": "llama", **text},
            scale_factor=2,
            image_token_id=place("<image>"),
            **ends,
        )
    )
