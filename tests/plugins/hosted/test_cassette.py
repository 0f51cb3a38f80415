"""Cassettes: what is recorded is what is replayed, in order, and nothing else is."""

import json
import subprocess
import sys

import pytest

from karma.plugins.hosted.cassette import (
    FILE,
    Cassette,
    CassetteError,
    Reply,
)


def request(prompt, **more):
    return {"model": "m", "path": "/completions", "prompt": prompt, **more}


def say(text):
    return lambda: Reply(answer={"text": text})


def nobody():
    raise AssertionError("a replay asks nobody")


def lines(folder):
    return [json.loads(line) for line in (folder / FILE).read_text().splitlines()]


@pytest.fixture
def recorded(tmp_path):
    """A recording of two episodes: (folder, what the clock said)."""
    cassette = Cassette(tmp_path, "record")
    ticks = []
    for scope, words in (("one", ["a", "b", "a"]), ("two", ["a"])):
        cassette.begin(scope)
        ticks.append(cassette.clock())
        for number, word in enumerate(words):
            cassette.exchange(request(word), say(f"{scope} {word} {number}"), url="http://x/v1")
        ticks.append(cassette.clock())
    return tmp_path, ticks


def test_replay_answers_and_measures_as_recorded_asks_nobody_and_writes_nothing(recorded):
    folder, ticks = recorded
    before = (folder / FILE).read_bytes()
    cassette = Cassette(folder, "replay")
    found, looks = [], []
    for scope, words in (("one", ["a", "b", "a"]), ("two", ["a"])):
        cassette.begin(scope)
        looks.append(cassette.clock())
        found += [cassette.exchange(request(word), nobody) for word in words]
        looks.append(cassette.clock())
    said = [one.reply.answer["text"] for one in found]
    assert said == ["one a 0", "one b 1", "one a 2", "two a 0"]
    written = [line["seconds"] for line in lines(folder) if line["type"] == "Exchange"]
    assert [one.seconds for one in found] == written and min(written) > 0
    assert looks == ticks
    assert (folder / FILE).read_bytes() == before


def test_equal_requests_of_an_episode_are_replayed_in_their_order(tmp_path):
    cassette = Cassette(tmp_path, "record")
    for number in range(3):
        cassette.exchange(request("same"), say(str(number)))
    again = Cassette(tmp_path, "replay")
    said = [again.exchange(request("same"), nobody).reply.answer["text"] for _ in range(3)]
    assert said == ["0", "1", "2"]
    with pytest.raises(CassetteError, match=r"recorded 3 times in episode '' and is asked once"):
        again.exchange(request("same"), nobody)


def test_failure_is_replayed_as_a_failure(tmp_path):
    recording = Cassette(tmp_path, "record")
    for shared in (False, True):
        recording.exchange(request("a"), lambda: Reply(failure="HTTP 429"), shared=shared)
    recording.exchange(request("a"), say("well"), shared=True)
    cassette = Cassette(tmp_path, "replay")
    replies = [cassette.exchange(request("a"), nobody, shared=True).reply for _ in range(3)]
    assert [reply.failure for reply in replies] == ["HTTP 429", "HTTP 429", ""]
    assert replies[2].answer == {"text": "well"}


def test_shared_answer_is_asked_for_once_and_holds_in_every_episode(tmp_path):
    cassette = Cassette(tmp_path, "record")
    cassette.begin("one")
    cassette.exchange(request("row"), say("1"), shared=True)
    resumed = Cassette(tmp_path, "record")
    resumed.begin("two")
    assert resumed.exchange(request("row"), nobody, shared=True).reply.answer == {"text": "1"}
    replayed = Cassette(tmp_path, "replay")
    replayed.begin("three")
    assert replayed.exchange(request("row"), nobody, shared=True).scope == "one"


# ----------------------------------------------------------------- keys


def test_volatile_fields_are_no_part_of_the_key_and_not_kept(tmp_path):
    cassette = Cassette(tmp_path, "record")
    cassette.exchange(request("a", user="u-1", metadata={"run": 1}, stop=None), say("x"))
    again = Cassette(tmp_path, "replay")
    assert again.exchange(request("a", user="u-2"), nobody).reply.answer == {"text": "x"}
    assert lines(tmp_path)[0]["request"] == request("a")


# ----------------------------------------------------------------- misses


def test_miss_shows_the_nearest_request_and_the_difference(tmp_path):
    cassette = Cassette(tmp_path, "record")
    cassette.begin("one")
    for fruit in ("apple", "tomato"):
        cassette.exchange(request(f"#areas\nnode_1\n#task chill the {fruit}\n"), say("x"))
    again = Cassette(tmp_path, "replay")
    again.begin("one")
    with pytest.raises(CassetteError) as caught:
        again.exchange(request("#areas\nnode_1\n#task chill the potato\n", seed=1), nobody)
    text = str(caught.value)
    assert FILE in text
    assert "of episode 'one' was not recorded; the nearest differs:" in text
    assert "\n    -prompt: |#task chill the tomato\n" in text
    assert "\n    +prompt: |#task chill the potato\n" in text
    assert "\n    +seed: 1\n" in text
    assert "To fix: " in text
    assert "apple" not in text


def test_clock_looked_at_more_often_than_recorded_is_an_error(recorded):
    folder, _ = recorded
    cassette = Cassette(folder, "replay")
    cassette.begin("two")
    cassette.clock(), cassette.clock()
    with pytest.raises(CassetteError, match="went another way than its recording"):
        cassette.clock()


# ----------------------------------------------------------------- the file


def test_torn_last_line_is_dropped_recording_and_named_replaying(recorded):
    folder, _ = recorded
    path = folder / FILE
    whole = path.read_bytes()
    count = whole.count(b"\n")
    for cut in (1, len(whole.splitlines()[-1]) - 1):
        path.write_bytes(whole[:-1][: len(whole) - cut])
        with pytest.raises(CassetteError, match=rf"line {count} is torn.*(\n.*)*To fix: "):
            Cassette(folder, "replay")
        Cassette(folder, "record")
        assert path.read_bytes() == b"".join(whole.splitlines(keepends=True)[:-1])
        Cassette(folder, "replay")
        path.write_bytes(whole)


def test_episode_begun_again_replaces_what_was_recorded_of_it(recorded):
    folder, _ = recorded
    resumed = Cassette(folder, "record")
    resumed.begin("one")
    resumed.exchange(request("a"), say("new"))
    cassette = Cassette(folder, "replay")
    cassette.begin("one")
    assert cassette.exchange(request("a"), nobody).reply.answer == {"text": "new"}
    with pytest.raises(CassetteError, match="was not recorded"):
        cassette.exchange(request("b"), nobody)
    with pytest.raises(CassetteError, match="another way"):
        cassette.clock()
    cassette.begin("two")
    assert cassette.exchange(request("a"), nobody).reply.answer == {"text": "two a 0"}


@pytest.mark.parametrize("mode", ["record", "replay"])
@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        (b'"prompt":"b"', b'"prompt":"c"', "line 4: the request is not what its SHA-256 says"),
        (b"one b 1", b"one b 2", "line 4: the reply is not what its SHA-256 says"),
        (b'"type":"Begin"', b'"type":"Bogin"', "line 1: Invalid value 'Bogin'"),
        (b'{"count":0,', b"{", "line 2: Object missing required field `count`"),
    ],
)
def test_damaged_line_is_refused_by_number(recorded, mode, old, new, named):
    folder, _ = recorded
    path = folder / FILE
    data = path.read_bytes()
    assert old in data
    path.write_bytes(data.replace(old, new, 1))
    with pytest.raises(CassetteError) as caught:
        Cassette(folder, mode)
    assert named in str(caught.value)
    assert FILE in str(caught.value)


def test_missing_cassette_says_how_to_record_one(tmp_path):
    with pytest.raises(CassetteError, match=r"no such cassette\n  To fix: record one first"):
        Cassette(tmp_path, "replay")
    with pytest.raises(CassetteError, match="add --cassette DIR"):
        Cassette(None, "record")


# ----------------------------------------------------------------- several processes


def elsewhere(code, *arguments):
    """Run code in another process, which has `Cassette`, `Tape`, `Reply` and `sys`."""
    start = (
        "import sys\nfrom pathlib import Path\n"
        "from karma.plugins.hosted.cassette import Cassette, CassetteError, Reply, Tape\n"
    )
    return subprocess.Popen(
        [sys.executable, "-c", start + code, *map(str, arguments)],
        stdout=subprocess.PIPE,
        text=True,
    )


TAKES_PART = """
folder, token, name = sys.argv[1:]
cassette = Cassette.of(Tape(folder=Path(folder), mode="record", token=token))
for episode in range(5):
    cassette.begin(f"{name}-{episode}")
    cassette.clock()
    for word in range(8):
        row = lambda: Reply(answer={"row": f"of {name}"})
        told = cassette.exchange({"input": word}, row, shared=True).reply.answer["row"]
        said = Reply(answer={"text": f"{word} {told}"})
        cassette.exchange({"prompt": "x" * 20_000}, lambda: said)
"""


def test_processes_that_record_at_once_keep_every_line_whole_and_each_its_answers(tmp_path):
    recording = Cassette(tmp_path, "record")
    names = ("ann", "bob", "cleo")
    workers = [elsewhere(TAKES_PART, tmp_path, recording.tape.token, name) for name in names]
    assert [worker.wait(120) for worker in workers] == [0, 0, 0]
    written = lines(tmp_path)
    shared = [line["key"] for line in written if line.get("shared")]
    assert len(shared) == len(set(shared)) == 8
    replayed = Cassette(tmp_path, "replay")
    for name in names:
        for episode in range(5):
            replayed.begin(f"{name}-{episode}")
            assert replayed.clock() > 0
            for word in range(8):
                row = replayed.exchange({"input": word}, nobody, shared=True).reply.answer["row"]
                said = replayed.exchange({"prompt": "x" * 20_000}, nobody).reply.answer["text"]
                assert said == f"{word} {row}"


def test_line_torn_by_another_process_is_dropped_before_the_next_is_written(tmp_path):
    one, other = (Cassette(tmp_path, "record") for _ in range(2))
    joined = Cassette.of(other.tape)
    joined.begin("one")
    whole = (tmp_path / FILE).read_bytes()
    (tmp_path / FILE).write_bytes(whole + b'{"scope":"two","type":"Be')
    joined.exchange(request("a"), say("x"))
    assert (tmp_path / FILE).read_bytes().startswith(whole + b'{"count":0,')
    with pytest.raises(CassetteError, match="another recording has begun here since"):
        one.begin("three")
    assert len(lines(tmp_path)) == 2


def test_two_processes_cannot_record_into_one_folder(tmp_path):
    recording = Cassette(tmp_path, "record")
    recording.begin("one")
    code = "try: Cassette(sys.argv[1], 'record')\nexcept CassetteError as error: print(error)"
    said, _ = elsewhere(code, tmp_path).communicate(timeout=120)
    assert "another process records here" in said
    assert (tmp_path / "exchanges.jsonl").read_bytes().count(b"\n") == 1
