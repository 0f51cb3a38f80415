"""Dialects of servers that are not here, by their protocol: stand-ins on this machine.

A stand-in takes the fields that its dialect has, holds its answers to them, and drops the others
without a word, as the real servers do. The real llama-server has `test_real_server.py`.
"""

import json
import re

import pytest
from support.grammar_oracle import is_valid
from support.hosted_server import PROMPT, chat, endpoint, plant_key, wire_server
from support.plans import PLANS, plan

from karma.agent.planning.program import SKILLS
from karma.errors import ModelError, ServerLost
from karma.plugins.baselines.lota import chooser_of
from karma.plugins.hosted.dialects import DIALECTS
from karma.plugins.hosted.grammars import gbnf
from karma.plugins.hosted.planner import open_planner
from karma.types.planning import ProgramSpec
from karma.types.roles import ScoringModel

SPEC = ProgramSpec(skills=SKILLS, objects=("Mug",), max_calls=2)
PROGRAM = "GoToObject(robot, 'Mug')\n"
AS_JSON = '{"program": [{"skill": "GoToObject", "object": "Mug"}]}'
PAGES = {
    "vllm": {"/version": {"version": "0.33.0"}},
    "sglang": {"/server_info": {"model_path": "m", "tokenizer_path": "m"}},
    "ollama": {"/api/version": {"version": "0.13.0"}},
    "plain": {},
}
FREE = "Sure! It is sunny."


@pytest.fixture(autouse=True)
def planted_key(monkeypatch):
    plant_key(monkeypatch)


def held_by_grammar(grammar):
    """What a stand-in says under a grammar of ours; None where it cannot read one."""
    words = re.findall(r"k-[0-9a-f]{8}", grammar)
    if words:
        return f"{words[0]}\n"
    return PROGRAM if grammar.startswith('root ::= line ("\\n" line){0,1}') else None


def held_by_schema(schema):
    words = [f'{{"k": "{word}"}}' for word in re.findall(r"k-[0-9a-f]{8}", json.dumps(schema))]
    return next((text for text in (*words, AS_JSON) if is_valid(schema, text)), None)


def held(name, body):
    """What a server of that dialect says to a body; FREE where it sees no constraint."""
    schema = body.get("response_format", {}).get("json_schema", {}).get("schema")
    if name == "vllm":
        inside = body.get("structured_outputs", {})
        if len(inside) == 1:
            ((kind, value),) = inside.items()
            readers = {"grammar": held_by_grammar, "json": held_by_schema}
            return readers[kind](value)
    if name == "sglang" and "ebnf" in body:
        return held_by_grammar(body["ebnf"])
    return held_by_schema(schema) if schema is not None else FREE


def stand_in(name, *, holds=True):
    def answer(path, body, headers):
        text = held(name, body) if holds else FREE
        return (400, {}, b'{"error": "no grammar"}') if text is None else chat(text)

    return wire_server(answer, pages=PAGES[name])


def auto(url, **more):
    return endpoint(url, "m", dialect="auto", **more)


CHOICES = [
    (name, constraint)
    for name in PAGES
    for constraint in sorted(DIALECTS[name].bindings)
]  # fmt: skip


@pytest.mark.parametrize(("name", "constraint"), CHOICES)
def test_stand_in_is_known_by_its_page_and_held_to_programs(name, constraint):
    with stand_in(name) as (url, seen):
        model = open_planner(auto(url, constraint=constraint), constrained=True)
        said = model.complete(PROMPT, spec=SPEC)
    assert model.manner.dialect.name == name
    assert (said.text, said.constrained, said.fault) == (PROGRAM, True, "")
    assert len(seen) == 2 + 1  # the canary, twice


@pytest.mark.parametrize(("name", "constraint"), CHOICES)
def test_stand_in_that_holds_nothing_is_refused(name, constraint):
    named = r"held to 'k-.*it said 'Sure! It is sunny\.'"
    with stand_in(name, holds=False) as (url, _), pytest.raises(ModelError, match=named):
        open_planner(auto(url, constraint=constraint), constrained=True)


def test_server_without_a_grammar_is_refused_by_name_unless_told_otherwise():
    with stand_in("plain") as (url, seen):
        place = endpoint(url, "m", dialect="plain")
        with pytest.raises(ModelError, match=r"dialect 'plain' takes no grammar\n  To fix: con"):
            open_planner(place, constrained=True)
        assert seen == []
        said = open_planner(place).complete(PROMPT, spec=SPEC)
    assert (said.text, said.constrained, said.fault) == (FREE, False, "")


@pytest.mark.parametrize(
    ("dialect", "field"),
    [
        ("plain", lambda b: b["response_format"]["json_schema"]["schema"] == PLANS.schema),
        ("vllm", lambda b: b["structured_outputs"] == {"grammar": gbnf(PLANS.grammar)}),
    ],
)
def test_plans_are_asked_for_as_each_server_takes_it(dialect, field):
    answers = iter((plan(0, 1), plan(99)))
    with wire_server(lambda *_: chat(next(answers))) as (url, seen):
        model = open_planner(endpoint(url, model="m", dialect=dialect))
        held, broken = (model.complete(PROMPT, spec=PLANS) for _ in range(2))
    assert field(next(body for path, body, _ in seen if path.endswith("completions")))
    assert (held.text, held.constrained, broken.constrained) == (plan(0, 1), True, False)


# ----------------------------------------------------------------- thoughts


@pytest.mark.parametrize(
    ("name", "thinking", "fields"),
    [
        ("vllm", "off", {"chat_template_kwargs": {"enable_thinking": False}}),
        ("vllm", "on", {"chat_template_kwargs": {"enable_thinking": True},
                        "thinking_token_budget": 30, "max_tokens": 50}),
        ("sglang", "off", {"chat_template_kwargs": {"enable_thinking": False}}),
        ("ollama", "off", {"reasoning_effort": "none"}),
        ("plain", "off", {"max_tokens": 20}),
        ("plain", "on", {"max_tokens": 50}),
    ],
)  # fmt: skip
def test_thinking_is_switched_as_the_dialect_wants(name, thinking, fields):
    with stand_in(name) as (url, seen):
        model = open_planner(auto(url), thinking=thinking, thinking_tokens=30)
        model.complete(PROMPT, max_tokens=20)
    ((_, body, _),) = seen
    assert {name: body.get(name) for name in fields} == fields


MESSAGES = [
    ({"content": PROGRAM, "reasoning_content": "A mug."}, PROGRAM, "A mug."),
    ({"content": f"\n\n{PROGRAM}", "reasoning": "A mug."}, PROGRAM, "A mug."),
    ({"content": PROGRAM, "thinking": "A mug."}, PROGRAM, "A mug."),
    ({"content": f"<think>\nA mug.\n</think>\n\n{PROGRAM}"}, PROGRAM, "A mug."),
    ({"content": f"A mug.\n</think>\n\n{PROGRAM}"}, PROGRAM, "A mug."),
    ({"content": f"[THINK]A mug.[/THINK]{PROGRAM}"}, PROGRAM, "A mug."),
    ({"content": "<think>\nA mug"}, "", "A mug"),
    ({"content": None, "reasoning_content": "A mug"}, "", "A mug"),
    ({"content": PROGRAM}, PROGRAM, ""),
]


@pytest.mark.parametrize(("message", "text", "reasoning"), MESSAGES)
def test_thought_is_kept_apart_wherever_it_comes_back(message, text, reasoning):
    choice = {"message": message, "finish_reason": "stop"}
    data = json.dumps({"choices": [choice]}).encode()
    with wire_server(lambda *_: (200, {}, data)) as (url, _):
        said = open_planner(endpoint(url, "m")).complete(PROMPT)
    assert (said.text, said.reasoning) == (text, reasoning)


# ----------------------------------------------------------------- answers are read all the same


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("GoToObject(robot, 'Cup')\n", "names what is not there"),
        ("GoToObject(robot, 'Mug'", "the answer is not of the form"),
        (PROGRAM * 3, "the answer is not of the form"),
        ("", "the answer is not of the form"),
    ],
)
def test_answer_outside_the_language_is_a_miss_with_a_fault(text, fault):
    with wire_server(lambda *_: chat(text), pages=PAGES["vllm"]) as (url, _):
        said = open_planner(auto(url)).complete(PROMPT, spec=SPEC)
    assert (said.text, said.constrained) == (text, False)
    assert fault in said.fault


def test_answer_cut_at_its_budget_has_a_fault_also_where_nothing_holds_it():
    choice = {"message": {"content": PROGRAM}, "finish_reason": "length"}
    data = json.dumps({"choices": [choice]}).encode()
    with wire_server(lambda *_: (200, {}, data)) as (url, _):
        said = open_planner(endpoint(url, "m")).complete(PROMPT)
    assert (said.finish, said.constrained) == ("length", False)
    assert said.fault == "the answer was cut off: it must be shorter"


# ----------------------------------------------------------------- model and address


def test_server_whose_template_has_no_system_message_is_asked_without_from_then_on():
    def answer(path, body, headers):
        if body["messages"][0]["role"] == "system":
            return 400, {}, b'{"error": {"message": "System role not supported"}}'
        return chat(PROGRAM)

    with wire_server(answer) as (url, seen):
        model = open_planner(endpoint(url, "m"))
        assert model.complete(PROMPT).text == model.complete(PROMPT).text == PROGRAM
    roles = [[one["role"] for one in body["messages"]] for _, body, _ in seen]
    assert roles == [["system", "user"], ["user"], ["user"]]
    assert seen[1][1]["messages"][0]["content"] == PROMPT.stable + PROMPT.changing


@pytest.mark.parametrize(
    ("content", "text", "thought"),
    [
        ([{"type": "text", "text": PROGRAM}], PROGRAM, ""),
        ([{"type": "text", "text": one} for one in (PROGRAM[:9], PROGRAM[9:])], PROGRAM, ""),
        ([{"text": PROGRAM}], PROGRAM, ""),
        (
            [{"type": "thinking", "thinking": [{"type": "text", "text": "An apple."}]},
             {"type": "text", "text": PROGRAM}], PROGRAM, "An apple.",
        ),
        ([{"type": "image", "url": "x"}, {"type": "output_text", "text": PROGRAM}], PROGRAM, ""),
    ],
)  # fmt: skip
def test_answer_in_parts_is_read_whole(content, text, thought):
    choice = {"message": {"role": "assistant", "content": content}, "finish_reason": "stop"}
    data = json.dumps({"choices": [choice]}).encode()
    with wire_server(lambda *_: (200, {}, data)) as (url, _):
        said = open_planner(endpoint(url, "m")).complete(PROMPT)
    assert (said.text, said.reasoning) == (text, thought)


@pytest.mark.parametrize("key", ["", "EMPTY", "ollama", "none", "x"])
def test_lab_servers_without_keys_are_asked_and_say_themselves_what_they_want(monkeypatch, key):
    monkeypatch.setenv("OPENAI_API_KEY", key)
    with wire_server(lambda *_: chat(PROGRAM + f"# {key}")) as (url, seen):
        model = open_planner(endpoint(f" {url}/chat/completions/ ", "m"))
        assert model.complete(PROMPT).text == PROGRAM + f"# {key}"  # a word is masked nowhere
    assert seen[0][2]["authorization"] == f"Bearer {key or 'none'}"
    asks = pytest.raises(ServerLost, match=r"who are you\?.*\n  To fix: .*OPENAI_API_KEY")
    said = b'{"error": {"message": "who are you?"}}'
    with wire_server(lambda *_: (401, {}, said)) as (url, _), asks:
        open_planner(endpoint(url.replace("127.0.0.1", "0.0.0.0"), "m")).complete(PROMPT)


def test_pages_that_say_yes_to_everything_are_no_dialect():
    """As LM Studio's do: status 200, and an error inside."""
    error = {"error": "Unexpected endpoint"}
    pages = {page: error for page in ("/props", "/version", "/server_info", "/api/version")}
    with wire_server(lambda *_: chat("x"), pages=pages) as (url, _):
        assert open_planner(auto(url)).manner.dialect.name == "plain"


# ----------------------------------------------------------------- scoring


@pytest.mark.parametrize("name", sorted(PAGES))
def test_server_that_tells_no_chances_is_refused_by_name_for_scoring(name):
    with stand_in(name) as (url, _):
        model = open_planner(auto(url))
    assert not isinstance(model, ScoringModel)
    with pytest.raises(ModelError, match=r"m: lota\.score needs log-probabilities"):
        chooser_of(model)
