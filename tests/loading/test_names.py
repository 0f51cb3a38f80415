"""Names are checked before a model loads, each with the nearest that there is."""

import subprocess
import sys

import pytest

from karma import registry
from karma.errors import FileError, KarmaError, ModelError, UnknownNameError
from karma.loading.models import Models, preset
from karma.loading.names import MODELS, check_models, check_options, check_row
from karma.world.core.scene import SCENES, find


@pytest.mark.parametrize(
    ("key", "said", "meant"),
    [
        ("planner", "karma-nanno", "karma-nano"),
        ("profile", "compcat", "compact"),
        ("recall", "statefull", "stateful"),
        ("embedder", "minlm", "minilm"),
        ("embedder", "sentence:all-mpnet-base", "all-mpnet-base-v2"),
        ("vision", "nano-vml", "nano-vlm"),
        ("vision", "transformers:karma-nano-vml", "karma-nano-vlm"),
    ],
)
def test_name_of_a_model_is_refused_with_the_nearest(key, said, meant):
    with pytest.raises(UnknownNameError, match=f"^{key}: .*Did you mean '{meant}'"):
        check_models({key: said})


@pytest.mark.parametrize("name", ["metadata:x", "blind:karma-nano-vlm"])
def test_model_of_what_takes_none_is_refused_in_a_line(name):
    with pytest.raises(
        UnknownNameError, match=f"^vision: '{name}': .* takes no model\n  To fix: '"
    ):
        check_models({"vision": name})


def test_model_of_another_role_is_refused():
    with pytest.raises(ModelError, match=r"planner: .*not for role planner but for 'vlm'"):
        check_models({"planner": "karma-nano-vlm"})


def test_names_that_there_are_pass():
    check_models({key: getattr(Models(), key) for key in MODELS})
    check_models({"vision": "nano-vlm", "embedder": "sentence:minilm", "planner": "a/b.gguf"})


@pytest.mark.parametrize(
    ("option", "value", "meant"),
    [
        ("perception", "picturs", "Did you mean 'pictures'"),
        ("means", "usd", "Did you mean 'used'"),
        ("polcy", "lru[10]", "Did you mean 'policy'"),
        ("policy", "fifo-mrege[10]", "Did you mean 'fifo-merge'"),
        ("policy", "fifo-merge", r"name\[size\]"),
        ("recall_k", "three", "recall_k"),
    ],
)
def test_option_of_a_row_is_refused_by_name(option, value, meant):
    with pytest.raises(KarmaError, match=f"row 'ours': .*{meant}"):
        check_row("ours", "karma", {option: value}, {})


@pytest.mark.parametrize("method", registry.names("methods"))
def test_every_method_of_ours_says_which_options_it_takes(method):
    with pytest.raises(KarmaError, match="unknown option 'no_such'"):
        check_options(method, {"no_such": 1})


def test_unknown_room_and_preset_suggest_the_nearest():
    with pytest.raises(FileError, match="Did you mean 'kitchen_1'"):
        find("kichen_1")
    assert find("kitchen_1").parent == SCENES
    with pytest.raises(ValueError, match="Did you mean 'paper'"):
        preset("papers")


def test_unknown_vision_model_is_refused_before_the_planner_is_opened():
    program = (
        "import sys\nfrom karma.loading.models import Models, load_resources\n"
        "from karma.errors import UnknownNameError\n"
        "try:\n    load_resources(Models(vision='nano-vml'), maps=None, seed=0)\n"
        "except UnknownNameError:\n    sys.exit('llama_cpp' in sys.modules)\n"
        "sys.exit('not refused')\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (0, b"")
