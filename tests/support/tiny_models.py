"""Random models of the real architectures, a few hundred kB, through the real files."""

import torch
from tokenizers import (
    Tokenizer,
    decoders,
    models,
    normalizers,
    pre_tokenizers,
    processors,
    trainers,
)
from transformers import (
    BertConfig,
    BertModel,
    CLIPConfig,
    CLIPModel,
    CLIPTokenizer,
    SiglipConfig,
    SiglipModel,
)
from transformers.models.clip.image_processing_pil_clip import CLIPImageProcessorPil
from transformers.models.siglip.image_processing_pil_siglip import SiglipImageProcessorPil

WORDS = ["apple", "red", "mug", "fridge", "the", "is", "in", "a", "on", "table", "sofa"]
BERT = ["[PAD]", "[UNK]", "[CLS]", "[SEP]", "[MASK]", ".", "##s", "##e", *"bcdfghij", *WORDS]
SMALL = {
    "hidden_size": 32, "intermediate_size": 64, "num_hidden_layers": 2, "num_attention_heads": 2,
}  # fmt: skip
VISION = {**SMALL, "image_size": 32, "patch_size": 8}


def save_clip(folder):
    torch.manual_seed(1)
    text = {
        **SMALL, "vocab_size": 300, "max_position_embeddings": 20, "bos_token_id": 0,
        "eos_token_id": 1, "pad_token_id": 1,
    }  # fmt: skip
    config = CLIPConfig(text_config=text, vision_config=VISION, projection_dim=24)
    CLIPModel(config).save_pretrained(folder)
    clip_tokenizer().save_pretrained(folder)
    size = {"height": 32, "width": 32}
    CLIPImageProcessorPil(size={"shortest_edge": 32}, crop_size=size).save_pretrained(folder)
    return folder


def clip_tokenizer():
    letters = sorted(pre_tokenizers.ByteLevel.alphabet())[:140]
    names = ["<|startoftext|>", "<|endoftext|>", *letters, *(f"{x}</w>" for x in letters)]
    return CLIPTokenizer(vocab={name: number for number, name in enumerate(names)}, merges=[])


def save_siglip(folder):
    torch.manual_seed(2)
    text = {
        **SMALL, "vocab_size": 60, "max_position_embeddings": 16, "projection_size": 32,
        "eos_token_id": 1, "pad_token_id": 1, "bos_token_id": 0,
    }  # fmt: skip
    model = SiglipModel(SiglipConfig(text_config=text, vision_config=VISION))
    model.save_pretrained(folder)
    size = {"height": 32, "width": 32}
    SiglipImageProcessorPil(size=size).save_pretrained(folder)
    tokenizer = Tokenizer(models.Unigram())
    tokenizer.pre_tokenizer = pre_tokenizers.Metaspace()
    tokenizer.decoder = decoders.Metaspace()
    trainer = trainers.UnigramTrainer(
        vocab_size=60, special_tokens=["<unk>", "</s>"], unk_token="<unk>", show_progress=False
    )
    tokenizer.train_from_iterator([" ".join(WORDS)] * 3, trainer)
    tokenizer.save(str(folder / "tokenizer.json"))
    return folder


def bert_tokenizer():
    vocabulary = {word: number for number, word in enumerate(BERT)}
    tokenizer = Tokenizer(models.WordPiece(vocabulary, unk_token="[UNK]"))
    tokenizer.normalizer = normalizers.BertNormalizer()
    tokenizer.pre_tokenizer = pre_tokenizers.BertPreTokenizer()
    tokenizer.post_processor = processors.TemplateProcessing(
        single="[CLS] $A [SEP]", special_tokens=[("[CLS]", 2), ("[SEP]", 3)]
    )
    return tokenizer


def bert_config():
    return BertConfig(vocab_size=len(BERT), max_position_embeddings=64, **SMALL)


def save_sentence(folder):
    """A folder as sentence-transformers writes it: transformer, mean pooling, normalisation."""
    from sentence_transformers import SentenceTransformer
    from sentence_transformers.sentence_transformer.modules import Normalize, Pooling, Transformer

    torch.manual_seed(3)
    inner = folder / "inner"
    BertModel(bert_config()).save_pretrained(inner)
    bert_tokenizer().save(str(inner / "tokenizer.json"))
    (inner / "tokenizer_config.json").write_text(
        '{"tokenizer_class": "BertTokenizer", "model_max_length": 64}'
    )
    transformer = Transformer(str(inner))
    whole = SentenceTransformer(
        modules=[transformer, Pooling(SMALL["hidden_size"]), Normalize()], device="cpu"
    )
    whole.save(str(folder / "out"), create_model_card=False)
    return folder / "out"
