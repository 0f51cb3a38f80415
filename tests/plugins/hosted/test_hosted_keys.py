"""Keys of hosted models: on no path do they reach an answer, an error, a file or a log."""

import logging

import msgspec
import pytest
from support.hosted_server import (
    KEY,
    answer_or_story,
    chat,
    echo,
    endpoint,
    plant_key,
    wire_server,
)

from karma.errors import ModelError
from karma.models.endpoint import Endpoint
from karma.models.session import Session
from karma.plugins.hosted.cassette import Cassette
from karma.plugins.hosted.keys import Key
from karma.plugins.hosted.model import HostedLanguageModel
from karma.types.planning import Prompt


@pytest.fixture(autouse=True)
def planted_key(monkeypatch):
    plant_key(monkeypatch)


# ----------------------------------------------------------------- keys


LEAKS = {
    "in the text": (200, chat("your key is KEY")[2]),
    "as a name": (200, chat("x", KEY={"KEY": ["KEY"]})[2]),
    "bad request": (400, b'{"error": "KEY"}'),
    "server error as text": (500, b"<html>KEY</html>"),
    "another form": (200, b'{"choices": [{"message": {"content": ["KEY"]}}]}'),
    "elsewhere": (302, b"KEY"),
}
LOST = {
    "no object": (200, b'["KEY"]'),
    "too many": (429, b'{"error": "KEY"}'),
    "not JSON": (200, b'{"KEY": '),
    "an error in a 200": (200, b'{"error": {"message": "KEY"}}'),
    "hanging up": (None, b""),
    "unauthorized": (401, b'{"error": {"message": "Incorrect API key provided: KEY."}}'),
}


@pytest.mark.parametrize("how", [*LEAKS, *LOST])
def test_key_said_back_reaches_no_answer_error_cassette_or_log(how, tmp_path, caplog, capfd):
    caplog.set_level(logging.DEBUG)
    session = Session(Cassette(tmp_path, "record"))
    with wire_server(echo(*(LEAKS | LOST)[how])) as (url, seen):
        shown = answer_or_story(HostedLanguageModel(endpoint(url), session=session))
    assert seen[0][2]["authorization"] == f"Bearer {KEY}"
    tape = tmp_path / "exchanges.jsonl"
    kept = tape.read_text() if tape.exists() else ""
    assert kept.count("\n") == (how in LEAKS)
    logged = "\n".join([caplog.text, *(repr(record.__dict__) for record in caplog.records)])
    out, err = capfd.readouterr()
    for text in (shown, kept, logged, out, err, repr(session.ledger.take())):
        assert KEY not in text
    if how == "in the text":
        assert "your key is [key]" in shown
        assert "your key is [key]" in kept


def test_key_in_the_prompt_itself_is_not_kept(tmp_path):
    with wire_server(lambda *_: chat("x")) as (url, _):
        session = Session(Cassette(tmp_path, "record"))
        model = HostedLanguageModel(endpoint(url), session=session)
        model.complete(Prompt(stable="", changing=f"use {KEY}"))
    kept = (tmp_path / "exchanges.jsonl").read_text()
    assert KEY not in kept
    assert "use [key]" in kept


def test_key_shows_itself_to_nobody():
    key = Key(KEY)
    assert KEY not in f"{key!r} {key} {[key]} {{'k': {key!r}}}"
    assert key.out_of({KEY: [KEY, {"a": (1, f"x{KEY}")}]}) == {
        "[key]": ["[key]", {"a": [1, "x[key]"]}]
    }
    assert Key().out_of("none") == "none"


@pytest.mark.parametrize("value", ["a b", "with space 123", "line\nbreak-123", "schlüssel-123"])
def test_what_is_no_key_is_refused_without_being_shown(value, monkeypatch):
    monkeypatch.setenv("MY_KEY", value)
    with pytest.raises(ModelError, match=r"what \$MY_KEY holds is no key") as caught:
        HostedLanguageModel(endpoint("http://127.0.0.1:9/v1", key_variable="MY_KEY"))
    assert value not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"base_url": f"http://me:{KEY}@127.0.0.1/v1"}, "keys belong into the environment"),
        ({"base_url": f"http://127.0.0.1/v1?key={KEY}"}, "keys belong into the environment"),
        ({"base_url": "127.0.0.1:8000"}, "is no http"),
        ({"base_url": "http://127.0.0.1:abc/v1"}, "Port could not be cast"),
        ({"base_url": "http://127.0.0.1:99999/v1"}, "Port out of range"),
        ({"base_url": f"{KEY}@127.0.0.1:8000"}, "is no http"),
        ({"model": ""}, "model is empty"),
        ({"timeout_s": 0}, "timeout_s"),
        ({"extra": {"messages": []}}, "extra: 'messages' is set by karma"),
        ({"api_key": KEY}, "unknown field `api_key`"),
    ],
)
def test_endpoint_that_could_not_work_or_holds_a_key_is_refused(change, named):
    given = {"base_url": "http://127.0.0.1/v1", "model": "m", **change}
    with pytest.raises(msgspec.ValidationError, match=named) as caught:
        msgspec.convert(given, Endpoint)
    assert KEY not in str(caught.value)
