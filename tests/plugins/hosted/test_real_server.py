"""The dialect of llama.cpp's own server, against that server with weights made here and our own.

Skipped where it is not built: `make server`.
"""

import json
import os
import re
import urllib.error
import urllib.request
from concurrent.futures import ThreadPoolExecutor
from itertools import chain

import pytest
from support.hosted_server import (
    NANO,
    PROMPT,
    endpoint,
    plant_key,
    real_server,
    wire_server,
)
from support.needs import need_models

from karma.agent.planning.program import SKILLS, parse_program
from karma.errors import ModelError
from karma.household.types import object_types
from karma.models.constraint import admits
from karma.models.llama.model import LlamaModel
from karma.models.session import Session
from karma.plugins.hosted.cassette import Cassette
from karma.plugins.hosted.planner import open_planner
from karma.testing import make_planner
from karma.types.planning import ProgramSpec

SPEC = ProgramSpec(
    skills=SKILLS, objects=tuple(sorted(object_types())), positions=("node_1", "node_2")
)
SAMPLE = int(os.environ.get("KARMA_SAMPLE", "60"))  # programs of random weights
WIDE = ProgramSpec(
    skills=SKILLS, objects=SPEC.objects, positions=tuple(f"node_{n}" for n in range(1, 13)),
    max_calls=3,
)  # fmt: skip
FEW = ProgramSpec(
    skills=SKILLS, objects=("Apple", "Mug", "Sink"), positions=("node_1", "node_2"), max_calls=3
)


@pytest.fixture(autouse=True)
def planted_key(monkeypatch):
    plant_key(monkeypatch)


@pytest.fixture(scope="module")
def nano(tmp_path_factory):
    """The shipped planner behind llama.cpp's own server."""
    need_models("karma-nano")
    with real_server(NANO, tmp_path_factory.mktemp("nano")) as url:
        yield url


@pytest.fixture(scope="module")
def local():
    """The shipped planner in this process."""
    need_models("karma-nano")
    model = LlamaModel(NANO)
    yield model
    model.close()


def served(family):
    @pytest.fixture(scope="module")
    def server(tmp_path_factory):
        folder = tmp_path_factory.mktemp(family)
        with real_server(make_planner(folder / "tiny.gguf", family), folder, slots=4) as url:
            yield url

    return server


llama3, qwen3, qwq = served("llama3"), served("qwen3"), served("qwq")


def auto(url, **more):
    return endpoint(url, "tiny", dialect="auto", **more)


def is_program(spec, text):
    return admits(spec.grammar, text)


# ----------------------------------------------------------------- held to programs


@pytest.mark.model
@pytest.mark.parametrize("api", ["chat", "completions"])
@pytest.mark.parametrize("constraint", ["grammar", "schema"])
def test_canary_passes_and_every_answer_is_a_program(nano, api, constraint):
    model = open_planner(auto(nano, api=api, constraint=constraint), constrained=True)
    spec = SPEC if constraint == "grammar" else FEW
    for seed in range(3):
        said = model.complete(PROMPT, spec=spec, temperature=2.0, seed=seed, max_tokens=1000)
        assert (said.constrained, said.fault, said.finish) == (True, "", "stop")
        assert is_program(spec, said.text)


@pytest.mark.model
def test_answers_under_the_grammar_are_those_of_the_model_in_this_process(nano, local):
    model = open_planner(auto(nano, api="completions"), constrained=True)
    for task in ("put the apple in the fridge", "turn on the lamp"):
        prompt = type(PROMPT)(stable=PROMPT.stable, changing=f"#task {task}\n#program\n")
        assert model.complete(prompt, spec=SPEC).text == local.complete(prompt, spec=SPEC).text


@pytest.mark.parametrize("family", ["llama3", "qwen3"])
def test_random_weights_write_legal_programs_only(family, request):
    """Control: of the same model without the grammar nothing is a program."""
    place = auto(request.getfixturevalue(family))
    open_planner(place, constrained=True)  # the canary

    def line(first, spec, count):
        model = open_planner(place)
        asked = {"temperature": 1.5, "max_tokens": 400}
        return [model.complete(PROMPT, spec=spec, seed=n, **asked) for n in range(first, count, 4)]

    with ThreadPoolExecutor(4) as pool:
        held = list(chain(*pool.map(line, range(4), [WIDE] * 4, [SAMPLE] * 4)))
        free = list(chain(*pool.map(line, range(4), [None] * 4, [min(SAMPLE, 100)] * 4)))
    for said in held:
        assert said.constrained
        assert is_program(WIDE, said.text) and parse_program(said.text), said.text
    assert not [said.text for said in free if is_program(WIDE, said.text)]
    print(f"{family}: {len(held)} legal, {len({said.text for said in held})} of them different")


def forwarding(url, without):
    """Answers as the server at `url` does, to requests without some fields."""

    def answer(path, body, headers):
        kept = {name: value for name, value in body.items() if name not in without}
        request = urllib.request.Request(
            url.removesuffix("/v1") + path, json.dumps(kept).encode(),
            {"Content-Type": "application/json"},
        )  # fmt: skip
        try:
            with urllib.request.urlopen(request, timeout=60) as reply:
                return reply.status, {}, reply.read()
        except urllib.error.HTTPError as error:
            return error.code, {}, error.read()

    return answer


def pages_of(url):
    found = {}
    for page in ("/v1/models", "/props"):
        with urllib.request.urlopen(url.removesuffix("/v1") + page, timeout=60) as reply:
            found[page] = json.loads(reply.read())
    return found


def test_server_that_passes_over_the_grammar_is_refused_unless_told_otherwise(llama3):
    pages = pages_of(llama3)
    with wire_server(forwarding(llama3, {"grammar"}), pages=pages) as (url, _):
        named = r"tiny at 127\.0\.0\.1: answers are not held to programs: held to 'k-\w+' or .*\n"
        with pytest.raises(ModelError, match=named + "  To fix: constraint = 'free'"):
            open_planner(auto(url, api="completions"), constrained=True)
        said = open_planner(auto(url, api="completions")).complete(PROMPT, spec=FEW)
    assert said.constrained is False
    assert said.fault
    with wire_server(forwarding(llama3, set()), pages=pages) as (url, _):
        open_planner(auto(url, api="completions"), constrained=True)


# ----------------------------------------------------------------- thinking


@pytest.mark.parametrize("thinking", ["off", "on"])
def test_model_that_opens_its_thought_answers_with_a_program_either_way(qwen3, thinking):
    model = open_planner(auto(qwen3), constrained=True, thinking=thinking, thinking_tokens=20)
    said = model.complete(PROMPT, spec=FEW, temperature=1.0, max_tokens=200)
    assert is_program(FEW, said.text)
    assert said.constrained
    assert bool(said.reasoning) is (thinking == "on")


def test_template_that_opens_a_thought_is_held_only_with_thinking_on(qwq):
    with pytest.raises(ModelError, match=r"into its thought \(thinking = 'on' may help\)"):
        open_planner(auto(qwq), constrained=True)
    model = open_planner(auto(qwq), constrained=True, thinking="on", thinking_tokens=20)
    said = model.complete(PROMPT, spec=FEW, temperature=1.0, max_tokens=200)
    assert is_program(FEW, said.text)
    assert said.reasoning


# ----------------------------------------------------------------- model and address


# ----------------------------------------------------------------- cassette


def test_canary_and_answers_replay_with_the_server_gone(tmp_path, llama3, monkeypatch):
    place = auto(llama3)

    def asked(session, at=place):
        model = open_planner(at, session=session, constrained=True, seed=3)
        session.cassette.begin("one")
        return model.complete(PROMPT, spec=FEW, temperature=1.0, seed=1)

    recorded = asked(Session(Cassette(tmp_path, "record")))
    monkeypatch.delenv("OPENAI_API_KEY")
    gone = place.at("http://127.0.0.1:9/v1")
    assert asked(Session(Cassette(tmp_path, "replay")), gone) == recorded
    words = re.findall(r"k-[0-9a-f]{8}", (tmp_path / "exchanges.jsonl").read_text())
    assert len(set(words)) == 4
