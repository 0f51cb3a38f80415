"""Independent readers of grammars: llama.cpp's own GBNF, and a few lines of JSON schema."""

import ctypes
import json

import llama_cpp
import numpy as np


class LlamaGrammar:
    """Whether llama.cpp's grammar sampler lets a text through, and an answer end after it.

    Args:
        vocabulary: path of a GGUF whose tokens can write every text that is asked about.
    """

    def __init__(self, vocabulary, grammar, root="root"):
        parameters = llama_cpp.llama_model_default_params()
        parameters.vocab_only = True
        llama_cpp.llama_backend_init()
        self._model = llama_cpp.llama_model_load_from_file(str(vocabulary).encode(), parameters)
        self._vocab = llama_cpp.llama_model_get_vocab(self._model)
        self._end = llama_cpp.llama_vocab_eos(self._vocab)
        self._sampler = llama_cpp.llama_sampler_init_grammar(
            self._vocab, grammar.encode(), root.encode()
        )
        assert self._sampler, f"llama.cpp does not read this grammar:\n{grammar}"

    def __enter__(self):
        return self

    def __exit__(self, *_):
        llama_cpp.llama_sampler_free(self._sampler)
        llama_cpp.llama_model_free(self._model)

    def accepts(self, text):
        llama_cpp.llama_sampler_reset(self._sampler)
        for token in self._tokens(text.encode()):
            if not self._admits(token):
                return False
            llama_cpp.llama_sampler_accept(self._sampler, token)
        return self._admits(self._end)

    def _tokens(self, text):
        if not text:
            return []
        found = (llama_cpp.llama_token * (len(text) + 1))()
        count = llama_cpp.llama_tokenize(
            self._vocab, text, len(text), found, len(found), False, False
        )
        assert count > 0
        return found[:count]

    def _admits(self, token):
        data = (llama_cpp.llama_token_data * 1)(llama_cpp.llama_token_data(token, 0.0, 0.0))
        one = llama_cpp.llama_token_data_array(data=data, size=1, selected=-1, sorted=False)
        llama_cpp.llama_sampler_apply(self._sampler, ctypes.byref(one))
        return bool(np.isfinite(data[0].logit))


def is_valid(schema, text):
    """Whether a JSON text is valid under a schema of the few words that we use."""
    try:
        value = json.loads(text)
    except ValueError:
        return False
    return _valid(schema, value, schema.get("$defs", {}))


def _valid(schema, value, definitions):
    if "$ref" in schema:
        return _valid(definitions[schema["$ref"].rpartition("/")[2]], value, definitions)
    if "anyOf" in schema:
        return any(_valid(one, value, definitions) for one in schema["anyOf"])
    if schema["type"] == "string":
        known = isinstance(value, str) and value in schema.get("enum", [value])
        return known and len(value) <= schema.get("maxLength", len(value))
    if schema["type"] == "integer":
        return type(value) is int and schema["minimum"] <= value <= schema["maximum"]
    if schema["type"] == "array":
        return (
            isinstance(value, list)
            and schema.get("minItems", 0) <= len(value) <= schema["maxItems"]
            and all(_valid(schema["items"], one, definitions) for one in value)
        )
    fields = schema["properties"]
    assert schema["type"] == "object" and schema["additionalProperties"] is False
    return (
        isinstance(value, dict)
        and set(schema["required"]) <= value.keys() <= fields.keys()
        and all(_valid(fields[name], one, definitions) for name, one in value.items())
    )
