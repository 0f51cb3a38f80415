"""llama.cpp's eyes: where the package was built without them, that is said, with the way out."""

import numpy as np
import pytest

from karma.errors import ModelError
from karma.infer.checks.gguf import PROJECTOR, check_gguf
from karma.infer.llama import vision as llama_vision
from karma.infer.llama.vision import HANDLERS, LlamaVision, has_pictures, require_pictures


def test_an_unknown_family_is_refused_with_those_there_are():
    with pytest.raises(ModelError, match=r"no family 'gpt'; there are qwen2\.5-vl"):
        LlamaVision("a.gguf", "b.gguf", family="gpt")


@pytest.mark.skipif(has_pictures(), reason="this llama.cpp was built with pictures")
def test_a_build_without_pictures_says_how_to_build_one():
    with pytest.raises(ModelError, match=r"built without pictures") as caught:
        LlamaVision("a.gguf", "b.gguf")
    assert 'CMAKE_ARGS="-DLLAVA_BUILD=ON" pip install' in str(caught.value)


def test_projector_is_checked_by_the_sizes_that_it_has_and_is_no_language_model(tmp_path):
    import gguf

    writer = gguf.GGUFWriter(tmp_path / "mmproj.gguf", "clip")
    writer.add_uint32("clip.vision.embedding_length", 64)
    writer.add_uint32("clip.vision.block_count", 2)
    writer.add_uint32("clip.vision.attention.head_count", 4)
    writer.add_tensor("v.patch_embd.weight", np.zeros((64, 3, 14, 14), np.float32))
    writer.write_header_to_file()
    writer.write_kv_data_to_file()
    writer.write_tensors_to_file()
    writer.close()
    found = check_gguf(tmp_path / "mmproj.gguf", sizes=PROJECTOR)
    assert found["clip.vision.block_count"] == 2
    with pytest.raises(ModelError, match=r"mmproj\.gguf: .*clip\.context_length is None"):
        check_gguf(tmp_path / "mmproj.gguf")


def test_with_the_library_the_files_are_checked_next(monkeypatch, tmp_path):
    monkeypatch.setattr(llama_vision, "has_pictures", lambda: True)
    require_pictures()
    with pytest.raises(ModelError, match=r"a\.gguf"):
        LlamaVision(tmp_path / "a.gguf", tmp_path / "b.gguf")


@pytest.mark.parametrize("family", HANDLERS)
def test_no_family_s_template_ends_in_a_line_break_that_jinja_would_drop(family):
    from llama_cpp import llama_chat_format

    handler = getattr(llama_chat_format, llama_vision._CLASSES[family])
    assert not getattr(handler, "CHAT_FORMAT", "").endswith("\n")
