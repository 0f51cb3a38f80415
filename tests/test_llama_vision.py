"""llama.cpp's eyes: where the package was built without them, that is said, with the way out."""

import pytest

from karma.errors import ModelError
from karma.infer import llama_vision
from karma.infer.llama_vision import LlamaVision, has_pictures, require_pictures


def test_an_unknown_family_is_refused_with_those_there_are():
    with pytest.raises(ModelError, match=r"no family 'gpt'; there are qwen2\.5-vl"):
        LlamaVision("a.gguf", "b.gguf", family="gpt")


@pytest.mark.skipif(has_pictures(), reason="this llama.cpp was built with pictures")
def test_a_build_without_pictures_says_how_to_build_one():
    with pytest.raises(ModelError, match=r"built without pictures") as caught:
        LlamaVision("a.gguf", "b.gguf")
    assert 'CMAKE_ARGS="-DLLAVA_BUILD=ON" pip install' in str(caught.value)


def test_with_the_library_the_files_are_checked_next(monkeypatch, tmp_path):
    monkeypatch.setattr(llama_vision, "has_pictures", lambda: True)
    require_pictures()
    with pytest.raises(ModelError, match=r"a\.gguf"):
        LlamaVision(tmp_path / "a.gguf", tmp_path / "b.gguf")
