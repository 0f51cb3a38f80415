"""Hosted vision: the request's form, the picture in it, and answers read strictly.

llama-cpp-python's server takes the request; it has no small model that sees, so the answers that
make sense are a wire server's. Not covered: a hosted model that really looks.
"""

import base64
import re
from io import BytesIO

import numpy as np
import pytest
from PIL import Image
from support.hosted_server import chat, endpoint, wire_server
from support.needs import need_models
from support.paths import ROOT
from support.sights import seen as seen_object

from karma.bench.engine.run import Run
from karma.models.session import Session
from karma.plugins.hosted.cassette import Cassette
from karma.plugins.hosted.model import HostedVision

MUG = seen_object("Mug|1")
TASKS = ROOT / "eval" / "alfred_l" / "tasks.jsonl"


def picture():
    return np.random.default_rng(0).integers(0, 256, (6, 8, 3), dtype=np.uint8)


def test_vision_sends_the_picture_whole_and_reads_states_strictly(tmp_path):
    session = Session(Cassette(tmp_path, "record"))
    frame = picture()
    with wire_server(lambda *_: chat("A mug.\nMug: dirty, filled\nCup: clean\n")) as (url, seen):
        found = HostedVision(endpoint(url, "eyes"), session=session).read_states(
            frame, "wash the mug", [MUG]
        )
    assert found == {"Mug|1": ("dirty", "filled")}
    part, text = seen[0][1]["messages"][1]["content"]
    kind, data = part["image_url"]["url"].split(",")
    assert kind == "data:image/png;base64"
    assert np.array_equal(np.asarray(Image.open(BytesIO(base64.b64decode(data)))), frame)
    assert "wash the mug" in text["text"]
    kept = (tmp_path / "exchanges.jsonl").read_text()
    assert "base64" not in kept
    assert '"picture":"8x6 ' in kept


def test_vision_asks_once_more_about_what_could_not_be_read():
    answers = iter([chat("Mug: dirty\nApple: rotten\n"), chat("apple: Sliced, dirty.\n")])
    with wire_server(lambda *_: next(answers)) as (url, seen):
        found = HostedVision(endpoint(url, "eyes")).read_states(
            picture(), "x", [MUG, seen_object("Apple|1")]
        )
    assert found == {"Mug|1": ("dirty",), "Apple|1": ("dirty", "sliced")}
    first, second = (body["messages"] for _, body, _ in seen)
    assert second[:2] == first
    assert second[2] == {"role": "assistant", "content": "Mug: dirty\nApple: rotten\n"}
    assert "about: Apple. These could not be used: line 2: 'rotten'" in second[3]["content"]


def dirty(path, body, headers):
    """Says of every object that it is asked about that it is dirty."""
    text = body["messages"][1]["content"][1]["text"]
    names = re.search(r"the mentioned objects: (.*)\.\n", text)[1].split(", ")
    return chat("\n".join(f"{name}: dirty" for name in names), usage={"prompt_tokens": 900})


@pytest.mark.model
def test_run_that_looks_through_a_host_replays_the_same_bytes(tmp_path):
    need_models("karma-nano")
    path = tmp_path / "x.toml"
    with wire_server(dirty) as (url, seen):
        path.write_text(
            f'name = "x"\ntasks = "{TASKS}"\nonly = ["simple-12"]\n[[rows]]\nname = "x"\n'
            f'[models]\nvision = "openai"\n[models.hosted.vision]\nbase_url = "{url}"\n'
            'model = "eyes"\n'
        )
        recorded = Run(path, tmp_path / "record", cassette=Cassette(tmp_path / "tape", "record"))
        (record,) = recorded.episodes()
    asked = len(seen)
    replayed = Run(path, tmp_path / "replay", cassette=Cassette(tmp_path / "tape", "replay"))
    assert list(replayed.episodes()) == [record]
    assert record.error == ""
    assert sum(one.requests for one in record.spent()) == asked > 0
    assert {one.role for one in record.spent()} == {"vision"}
    files = [
        {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}
        for folder in (tmp_path / "record", tmp_path / "replay")
    ]
    assert files[0] == files[1]
