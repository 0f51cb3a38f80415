"""Hosted models: against llama-cpp-python's own server with the nano planner, and a naughty one.

Covered: planner and embedder, the bill, what comes back wrong, who may be reached.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import threading

import numpy as np
import pytest
from support.hosted_server import (
    KEY,
    PRICES,
    PROMPT,
    REMOTE,
    chat,
    endpoint,
    free_port,
    need_loopback,
    plant_key,
    wire_server,
)
from support.needs import need_namespace
from support.paths import ROOT

from karma.agent.planning.program import parse_program
from karma.errors import KarmaError, ModelError, ServerLost
from karma.models.session import Session
from karma.plugins.hosted.cassette import Cassette
from karma.plugins.hosted.model import HostedEmbedder, HostedLanguageModel
from karma.types.planning import Prompt

TASKS = ROOT / "eval" / "alfred_l" / "tasks.jsonl"


@pytest.fixture(autouse=True)
def planted_key(monkeypatch):
    plant_key(monkeypatch)


# ----------------------------------------------------------------- the roles, on the real server


@pytest.mark.model
def test_chat_and_completions_give_the_nano_planner_s_program(server):
    found = [
        HostedLanguageModel(endpoint(server, model, api=api)).complete(PROMPT, max_tokens=200)
        for model, api in (("nano", "completions"), ("nano-chat", "chat"))
    ]
    assert found[0].text == found[1].text
    assert parse_program(found[0].text)
    for one in found:
        assert one.finish == "stop"
        assert min(one.prompt_tokens, one.completion_tokens) > 9
        assert (one.reused_tokens, one.first_token_s, one.cost) == (None, None, None)
        assert one.total_s > 0


@pytest.mark.model
def test_embedder_gives_unit_rows_and_asks_once_for_each_text(server):
    session = Session()
    embedder = HostedEmbedder(endpoint(server, "nano-rows"), session=session)
    texts = ["an apple", "a clean plate", "an apple"]
    rows = embedder.embed(texts)
    assert rows.shape == (3, embedder.dimension)
    assert embedder.dimension > 100
    assert rows.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(rows, axis=1), 1.0, atol=1e-6)
    assert np.array_equal(rows[0], rows[2])
    assert not np.array_equal(rows[0], rows[1])
    assert embedder.embed([]).shape == (0, embedder.dimension)
    (spent,) = session.ledger.take()
    assert (spent.role, spent.requests, spent.completion_tokens) == ("embedder", 2, 0)


# ----------------------------------------------------------------- the wire


def test_request_says_what_the_endpoint_wants_and_nothing_it_refuses():
    with wire_server(lambda *_: chat("x")) as (url, seen):
        place = endpoint(
            url, "m", tokens_field="max_completion_tokens", omit=["temperature", "seed"],
            extra={"reasoning_effort": "low"},
        )  # fmt: skip
        HostedLanguageModel(place).complete(PROMPT, max_tokens=7, temperature=0.5, seed=3)
    ((path, body, headers),) = seen
    assert path == "/v1/chat/completions"
    assert body == {
        "model": "m", "max_completion_tokens": 7, "reasoning_effort": "low",
        "messages": [
            {"role": "system", "content": PROMPT.stable},
            {"role": "user", "content": PROMPT.changing},
        ],
    }  # fmt: skip
    assert headers["authorization"] == f"Bearer {KEY}"


def test_earlier_turns_are_messages_between_system_and_user():
    asked = Prompt(stable="Rules", changing="Now?", turns=(("First?", "No."),))
    with wire_server(lambda *_: chat("x")) as (url, seen):
        HostedLanguageModel(endpoint(url, "m")).complete(asked)
    assert [(one["role"], one["content"]) for one in seen[0][1]["messages"]] == [
        ("system", "Rules"), ("user", "First?"), ("assistant", "No."), ("user", "Now?"),
    ]  # fmt: skip


def test_environment_adds_no_organisation_and_no_proxy(monkeypatch):
    monkeypatch.setenv("OPENAI_ORG_ID", "org-1")
    monkeypatch.setenv("OPENAI_PROJECT_ID", "project-1")
    monkeypatch.setenv("HTTP_PROXY", f"http://127.0.0.1:{free_port()}")
    with wire_server(lambda *_: chat("x")) as (url, seen):
        HostedLanguageModel(endpoint(url)).complete(PROMPT)
    assert not any("openai-" in name.lower() for name in seen[0][2])


def test_refusal_and_missing_text_are_answers_that_hold_no_program():
    messages = iter([{"content": None, "refusal": "I must not."}, {"content": None}])

    def answer(*_):
        choice = {"message": next(messages), "finish_reason": "content_filter"}
        return 200, {}, json.dumps({"choices": [choice]}).encode()

    with wire_server(answer) as (url, _):
        model = HostedLanguageModel(endpoint(url))
        first, second = model.complete(PROMPT), model.complete(PROMPT)
    assert (first.text, second.text) == ("I must not.", "")
    assert (first.finish, first.prompt_tokens, first.completion_tokens) == ("filter", None, None)
    assert "withheld by the server's filter (content_filter)" in first.fault


def ended(reason, text="GoToObject(robot, 'Mug')"):
    choice = {"message": {"content": text}, "finish_reason": reason}
    return 200, {}, json.dumps({"choices": [choice]}).encode()


def page(text, kind="text/html"):
    return 200, {"Content-Type": kind}, text.encode()


TOO_MANY = '{"error": {"message": "Rate limit exceeded", "code": 429}}'
FAULTS = {
    "an error in a 200": (page(TOO_MANY), "429"),
    "no choices": (page('{"choices": null}'), "without choices"),
    "abort": (ended("abort"), "'abort'"),
    "a page": (page("<html>502</html>"), "no JSON"),
    "a dead engine": ((500, {}, b'{"error": {"message": "EngineCore is dead"}}'), "dead"),
    **{str(code): ((code, {}, b'{"error": {"message": "later"}}'), str(code))
       for code in (402, 408, 529)},
}  # fmt: skip


@pytest.mark.parametrize("dress", FAULTS)
def test_fault_of_the_server_in_any_dress_is_the_server_s_in_its_words_and_asked_again(dress):
    answer, words = FAULTS[dress]
    with wire_server(lambda *_: answer) as (url, seen):
        model = HostedLanguageModel(endpoint(url, retries=1))
        with pytest.raises(ServerLost, match=re.escape(words)) as raised:
            model.complete(PROMPT)
    assert not raised.value.agents_own
    assert len(seen) == (1 if dress == "402" else 2)


@pytest.mark.parametrize(
    ("data", "named"),
    [
        (b"{}", "no choice with a text"),
        (b'{"choices": []}', "an answer without choices"),
        (b'{"choices": [{"message": "x"}]}', "no choice with a text"),
        (b'{"choices": [{"message": {"content": ["x"]}}]}', "a list where a text should be"),
        (b"[1]", "no JSON object"),
        (b'{"choices": ', r"no JSON \(Input data was truncated\)"),
        (b"", "no JSON"),
    ],
)
def test_odd_answer_is_a_model_error_naming_model_and_host(data, named):
    with wire_server(lambda *_: (200, {}, data)) as (url, _):
        model = HostedLanguageModel(endpoint(url, "gpt-x"))
        with pytest.raises(ModelError, match=named) as caught:
            model.complete(PROMPT)
    assert str(caught.value).startswith("gpt-x at 127.0.0.1: ")


def test_server_that_is_not_there_is_named_with_a_fix():
    need_loopback()
    with pytest.raises(ModelError, match=r"127\.0\.0\.1: Connection error.*\n  To fix: see that a"):
        HostedLanguageModel(endpoint(f"http://127.0.0.1:{free_port()}/v1")).complete(PROMPT)


def test_server_that_says_nothing_is_given_up_after_the_timeout():
    over = threading.Event()
    with wire_server(lambda *_: over.wait(60) and chat("late")) as (url, _):
        model = HostedLanguageModel(endpoint(url, timeout_s=0.2))
        with pytest.raises(ModelError, match="timed out"):
            model.complete(PROMPT)
        over.set()


def test_missing_package_is_named_with_the_command_that_brings_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "openai", None)
    with pytest.raises(ModelError, match=r"To fix: pip install 'karma-offline\[hosted\]'"):
        HostedLanguageModel(endpoint("http://127.0.0.1:9/v1"))


# ----------------------------------------------------------------- the bill


def test_bill_counts_tokens_and_money_by_the_price_table():
    usage = {
        "prompt_tokens": 1000, "completion_tokens": 50,
        "prompt_tokens_details": {"cached_tokens": 600},
    }  # fmt: skip
    session = Session()
    with wire_server(lambda *_: chat("x", usage=usage)) as (url, _):
        plain = endpoint(url, prices=PRICES)
        cached = endpoint(url, prices={**PRICES, "cached_input": 0.5})
        said = [HostedLanguageModel(e, session=session).complete(PROMPT) for e in (plain, cached)]
    assert [one.cost for one in said] == pytest.approx([0.0024, 0.0015])
    assert [one.reused_tokens for one in said] == [600, 600]
    (spent,) = session.ledger.take()
    assert (spent.model, spent.requests, spent.failures) == ("wire-1", 2, 0)
    assert (spent.prompt_tokens, spent.completion_tokens) == (2000, 100)
    assert spent.cost == pytest.approx(0.0039)
    assert spent.seconds == pytest.approx(sum(one.total_s for one in said))
    assert session.ledger.take() == ()


def test_failed_request_is_counted_and_costs_no_tokens():
    session = Session()
    with wire_server(lambda *_: (400, {}, b"{}")) as (url, _):
        model = HostedLanguageModel(endpoint(url, "m", prices=PRICES), session=session)
        with pytest.raises(ModelError):
            model.complete(PROMPT)
    (spent,) = session.ledger.take()
    assert (spent.model, spent.requests, spent.failures, spent.cost) == ("m", 1, 1, 0.0)


# ----------------------------------------------------------------- who may be reached


def test_remote_host_needs_leave_unless_it_is_replayed_and_that_needs_no_key(tmp_path, monkeypatch):
    with pytest.raises(KarmaError, match=r"'models\.example\.com' is on another machine"):
        HostedLanguageModel(endpoint(REMOTE))
    with wire_server(lambda *_: chat("x")) as (url, _):
        place = endpoint(url)
        HostedLanguageModel(place, session=Session(Cassette(tmp_path, "record"))).complete(PROMPT)
    monkeypatch.setenv("OPENAI_API_KEY", "no key")
    replayed = HostedLanguageModel(place.at(REMOTE), session=Session(Cassette(tmp_path, "replay")))
    assert replayed.complete(PROMPT).text == "x"


WITH_ADDRESS = 'ip link set lo up && ip addr add 10.11.12.13/32 dev lo && exec "$@"'
# Serves at an address that is not loopback, and runs `karma` without leave and with it.
VISIT = """
import subprocess, sys
from support.hosted_server import chat, wire_server
program = "Explore(robot, 'Bed')"
usage = {"prompt_tokens": 9, "completion_tokens": 3}
karma = [sys.executable, "-c", "from karma.cli import app; app()"]
with wire_server(lambda *_: chat(program, usage=usage), host="10.11.12.13") as (url, seen):
    for leave in ([], ["--allow-network"]):
        out = "with" if leave else "without"
        command = [*karma, *leave, "eval", "x.toml", "--base-url", url, "--out", out]
        done = subprocess.run(command, capture_output=True, text=True)
        print(out, done.returncode, len(seen) > 0, done.stdout[-1500:], done.stderr[-1500:])
"""


def test_other_machine_is_reached_with_leave_only_and_the_header_says_so(tmp_path):
    if shutil.which("ip") is None:
        pytest.skip("needs ip")
    namespace = need_namespace("sh", "-c", WITH_ADDRESS, "sh", "true")
    (tmp_path / "x.toml").write_text(
        f'name = "x"\ntasks = "{TASKS}"\nonly = ["simple-12"]\n[[rows]]\nname = "x"\n'
        '[models]\nplanner = "openai"\nconstraint = "free"\n[models.hosted.planner]\n'
        'base_url = "http://127.0.0.1:9/v1"\nmodel = "m"\n'
    )
    environment = {k: v for k, v in os.environ.items() if k != "KARMA_OFFLINE"}
    environment["PYTHONPATH"] = f"{ROOT}{os.pathsep}{ROOT / 'tests'}"
    done = subprocess.run(
        [*namespace, "sh", "-c", WITH_ADDRESS, "sh", sys.executable, "-c", VISIT],
        cwd=tmp_path, env=environment, capture_output=True, text=True, check=True,
    )  # fmt: skip
    without, _, leave = done.stdout.partition("\nwith 0 True ")
    assert without.startswith("without 1 False ")
    assert "is on another machine" in without
    assert "karma --allow-network" in without
    assert "planner wire-1: " in leave
    assert json.loads((tmp_path / "with" / "header.json").read_text())["network"] is True
    assert not (tmp_path / "without" / "episodes.jsonl").exists()


def test_import_of_the_model_does_not_import_the_client():
    program = "import karma.plugins.hosted.model, sys; sys.exit('openai' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0
