"""What happens to a machine: killed processes, full disks, no memory, two at once in one folder.

Whatever it is, nothing that was written before is lost, nothing is torn, and the same command goes
on to the bytes of a run that nobody disturbed.
"""

import ctypes
import json
import multiprocessing
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import Any

from karma.agent.journal.header import EPISODES
from support.bundles import pack
from support.paths import ROOT
from support.run_files import TASKS, files, lines_in

EXPERIMENT = (
    f'name = "x"\ntasks = "{TASKS}"\nonly = ["simple-11", "simple-14"]\n'
    'seeds = [0, 1]\n[[rows]]\nname = "expert"\nmethod = "expert"\n'
)
EPISODES_IN_ALL = 4
_PATIENCE_S = 240.0
_OVERRIDE = 1  # CAP_DAC_OVERRIDE, by which root writes everywhere


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What a process may have."""

    most: Mapping[int, int] = field(default_factory=dict)  # RLIMIT_... -> value
    plain_user: bool = False  # without root's leave to write everywhere

    def take(self) -> None:
        """Put them on this process."""
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        sys.dont_write_bytecode = True  # half a .pyc would end whoever imports it next
        os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
        for what, value in self.most.items():
            resource.setrlimit(what, (value, value))


# ----------------------------------------------------------------- processes


class Child:
    """A process of ours, forked from one that has the libraries; ends with an exit code."""

    def __init__(self, work: Callable[..., None], *given: Any, limits: Limits | None = None):
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(["karma.cli", "karma.bench.engine.run", "llama_cpp"])
        self._said, theirs = context.Pipe(duplex=False)
        arguments = (theirs, limits or Limits(), work, given)
        self.process = context.Process(target=_begun, args=arguments)
        self.process.start()
        theirs.close()

    def kill_after(self, seconds: float, when: Callable[[], bool]) -> bool:
        """Kill it that long after something is so; returns whether it still lived."""
        until = time.monotonic() + _PATIENCE_S
        while self.process.is_alive() and not when() and time.monotonic() < until:
            time.sleep(0.005)
        self.process.join(seconds)
        lived = self.process.is_alive()
        self.process.kill()
        self.process.join()
        return lived

    def ended(self) -> tuple[int, str]:
        """Wait for its end; returns the exit code and what it printed."""
        self.process.join(_PATIENCE_S)
        assert self.process.exitcode is not None, "came to no end"
        said = b""
        while data := os.read(self._said.fileno(), 65536):
            said += data
        return self.process.exitcode, said.decode(errors="replace")


def _begun(said: Any, limits: Limits, work: Callable[..., None], given: tuple[Any, ...]) -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for number in (1, 2):
        os.dup2(said.fileno(), number)
    said.close()
    limits.take()
    work(*given)


def karma(*words: str, limits: Limits | None = None) -> tuple[int, str]:
    """Run a command in a process that has its limits from the start; as `Child.ended`."""
    given = limits or Limits()
    done = subprocess.run(
        [sys.executable, "-c", "from karma.cli import app; app()", *words],
        preexec_fn=partial(_limited, given), capture_output=True, check=False, cwd=ROOT,
        timeout=_PATIENCE_S, env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip
    return done.returncode, (done.stdout + done.stderr).decode(errors="replace")


def _limited(limits: Limits) -> None:
    if limits.plain_user and os.geteuid() == 0:  # what follows has no leave that root has
        dropped = ctypes.CDLL(None, use_errno=True).prctl(24, _OVERRIDE, 0, 0, 0)
        assert dropped == 0, "cannot give up root's leave"
    limits.take()


def plainly(code: int, said: str) -> None:
    """See that a command succeeded, or failed as commands do."""
    assert code in (0, 1), f"exit code {code}: {said[-400:]}"
    assert "Traceback" not in said, said[-600:]
    assert code == 0 or "error:" in said, f"no error is told: {said[-300:]}"


# ----------------------------------------------------------------- a run


@cache
def _whole() -> tuple[Path, Path]:
    """Return an experiment and the folder of its undisturbed run; made once per process."""
    place = Path(tempfile.mkdtemp(prefix="whole-"))
    path = place / "x.toml"
    path.write_text(EXPERIMENT)
    code, said = Child(evaluate, path, place / "run").ended()
    assert code == 0, said
    assert lines_in(place / "run" / EPISODES) == EPISODES_IN_ALL
    return path, place / "run"


def evaluate(path: Path, folder: Path, *options: str) -> None:
    """Do as `karma eval` does."""
    from karma.cli import app

    app(["eval", str(path), "--out", str(folder), *options])


def command(words: Sequence[str]) -> None:
    """Do as `karma` does."""
    from karma.cli import app

    app(words)


def _goes_on(folder: Path, before: list[bytes]) -> None:
    """See that what was done is there, and that the run ends in the undisturbed one's bytes."""
    path, whole = _whole()
    kept = _lines(folder)
    assert set(before) <= set(kept), "an episode that was done is lost"
    code, said = Child(evaluate, path, folder).ended()
    assert code == 0, said[-600:]
    assert set(kept) <= set(_lines(folder)), "an episode that was done was done again"
    one, other = files(folder), files(whole)
    wrong = sorted(name for name in {*one, *other} if one.get(name) != other.get(name))
    assert not wrong, f"differ after going on: {wrong[:5]}"


def _lines(folder: Path) -> list[bytes]:
    path = folder / EPISODES
    return path.read_bytes().split(b"\n")[:-1] if path.exists() else []


def until_free(folder: Path) -> None:
    """Wait until a killed run's workers are gone, which hold its lock no longer than they live."""
    from karma.agent.journal.owned_folder import locked
    from karma.errors import KarmaError

    until = time.monotonic() + _PATIENCE_S
    while True:
        try:
            with locked(folder):
                return
        except KarmaError:
            assert time.monotonic() < until, "workers outlive their run"
            time.sleep(0.05)


def _killed_worker(place: Path, rng: random.Random) -> None:
    folder, path = place / "run", _whole()[0]
    wanted = rng.randrange(EPISODES_IN_ALL - 1)
    child = Child(evaluate, path, folder, "--workers", "2")
    until = time.monotonic() + _PATIENCE_S
    while child.process.is_alive() and lines_in(folder / EPISODES) < wanted:
        assert time.monotonic() < until
        time.sleep(0.005)
    workers = _children(child.process.pid or 0)
    if workers:
        os.kill(rng.choice(workers), signal.SIGKILL)
    code, said = child.ended()
    assert code == 0, said[-600:]
    _goes_on(folder, _lines(folder))


def _children(pid: int) -> list[int]:
    """Return the processes that one has begun, as the kernel lists them."""
    listed = Path(f"/proc/{pid}/task/{pid}/children")
    found = [int(word) for word in listed.read_text().split()] if listed.exists() else []
    return [one for one in found if b"spawn_main" in Path(f"/proc/{one}/cmdline").read_bytes()]


def _limited_run(place: Path, limits: Limits) -> None:
    folder, path = place / "run", _whole()[0]
    code, said = Child(evaluate, path, folder, limits=limits).ended()
    plainly(code, said)
    _goes_on(folder, _lines(folder))


def _run_of_few_descriptors(place: Path, rng: random.Random) -> None:
    _limited_run(place, Limits(most={resource.RLIMIT_NOFILE: rng.randrange(8, 40)}))


def _two_runs(place: Path, rng: random.Random) -> None:
    folder, path = place / "run", _whole()[0]
    children = [Child(evaluate, path, folder) for _ in range(2)]
    ends = [child.ended() for child in children]
    assert 0 in [code for code, _ in ends], ends
    for code, said in ends:
        assert code == 0 or "another run is at work" in said, said[-400:]
    _goes_on(folder, _lines(folder))


# ----------------------------------------------------------------- recordings, maps, outputs


def record(folder: Path, acknowledged: Path, episodes: int) -> None:
    """Record some episodes; a byte goes behind `acknowledged` for each answer that is used."""
    from karma.plugins.hosted.cassette import Cassette, Reply

    cassette = Cassette(folder, "record")
    sink = os.open(acknowledged, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    for episode in range(episodes):
        cassette.begin(f"episode-{episode}")
        for word in range(6):
            said = Reply(answer={"text": f"{episode} {word} " + "x" * 3000})
            cassette.exchange({"prompt": f"{word}"}, lambda: said)  # noqa: B023
            os.write(sink, b".")


def _replayed(folder: Path, episodes: int) -> None:
    from karma.plugins.hosted.cassette import Cassette

    cassette = Cassette(folder, "replay")
    for episode in range(episodes):
        cassette.begin(f"episode-{episode}")
        for word in range(6):
            told = cassette.exchange({"prompt": f"{word}"}, _nobody).reply.answer
            assert told is not None
            assert told["text"].startswith(f"{episode} {word} ")


def _nobody() -> Any:
    raise AssertionError("a replay asks nobody")


def _answers(path: Path) -> int:
    lines = path.read_bytes().split(b"\n")[:-1] if path.exists() else []
    return sum(json.loads(line)["type"] == "Exchange" for line in lines)


def _recording(place: Path, rng: random.Random, limits: Limits | None) -> None:
    folder, acks, tape = place / "tape", place / "acks", place / "tape" / "exchanges.jsonl"
    child = Child(record, folder, acks, 40, limits=limits)
    if limits is None:
        wanted = rng.randrange(200)
        child.kill_after(rng.uniform(0, 0.05), lambda: acks.exists() and _size(acks) >= wanted)
    else:
        code, said = child.ended()
        assert code == 1, "recorded past the end of the disk"
        assert "CassetteError" in said, said[-400:]
        assert "exchanges.jsonl: cannot write" in said, said[-400:]
    assert _answers(tape) >= _size(acks), "an answer that was used is lost"
    code, said = Child(record, folder, acks, 40).ended()
    assert code == 0, said[-400:]
    _replayed(folder, 40)


def _size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


def _killed_recording(place: Path, rng: random.Random) -> None:
    _recording(place, rng, None)


def _recording_on_full_disk(place: Path, rng: random.Random) -> None:
    _recording(place, rng, Limits(most={resource.RLIMIT_FSIZE: rng.randrange(500, 200_000)}))


OUTPUTS: tuple[tuple[str, ...], ...] = (
    ("table", "RUN"), ("export", "RUN"),
    ("report", "RUN"),
)  # fmt: skip


def _output(place: Path, rng: random.Random, limits: Limits) -> None:
    folder = shutil.copytree(_whole()[1], place / "run")
    before = files(folder)
    words = [str(folder) if word == "RUN" else word for word in rng.choice(OUTPUTS)]
    if limits.plain_user:
        folder.chmod(0o500)
    code, said = (
        karma(*words, limits=limits) if limits.plain_user
        else Child(command, words, limits=limits).ended()
    )  # fmt: skip
    folder.chmod(0o755)
    plainly(code, said)
    after = files(folder)
    assert {name: after.get(name) for name in before} == before, "the run itself was changed"
    made = sorted(set(after) - set(before))
    assert not made or code == 0 or not limits.plain_user, f"wrote {made} all the same"
    assert not [name for name in made if name.endswith(".karma-part")], made


def _output_on_full_disk(place: Path, rng: random.Random) -> None:
    _output(place, rng, Limits(most={resource.RLIMIT_FSIZE: rng.randrange(100, 3000)}))


def _output_where_nothing_may_be_written(place: Path, rng: random.Random) -> None:
    _output(place, rng, Limits(plain_user=True))


def _run_where_nothing_may_be_written(place: Path, rng: random.Random) -> None:
    path, folder = _whole()[0], place / "run"
    folder.mkdir()
    folder.chmod(0o500)
    words = ("eval", str(path), "--out", str(folder))
    code, said = karma(*words, limits=Limits(plain_user=True))
    assert code == 1, said[-300:]
    plainly(code, said)
    assert str(folder) in "".join(said.split()), said[-300:]
    assert list(folder.iterdir()) == []
    folder.chmod(0o755)
    _goes_on(folder, [])


def _little_memory(place: Path, rng: random.Random) -> None:
    path = _whole()[0]
    folder, megabytes = place / "run", rng.randrange(150, 1500)
    words = rng.choice((("eval", str(path), "--out", str(folder)), ("world", "list")))
    code, said = karma(*words, limits=Limits(most={resource.RLIMIT_AS: megabytes << 20}))
    assert code in (0, 1), f"{megabytes} MB: exit code {code}: {said[-400:]}"
    assert "Traceback" not in said, f"{megabytes} MB: {said[-500:]}"
    assert code == 0 or "memory" in said.lower() or "error:" in said, said[-300:]
    if words[0] == "eval":
        _goes_on(folder, _lines(folder))


# ----------------------------------------------------------------- a bundle


@cache
def small_bundle() -> Path:
    """Return a bundle of one wheel, pip, and some files; made once per process."""
    import ensurepip

    sources = [*Path(ensurepip.__file__).parent.glob("_bundled/pip-*.whl")]
    parts = {f"wheels/{one.name}": one.read_bytes() for one in sources}
    parts |= {f"eval/{n}.toml": f"n = {n}\n".encode() * 20_000 for n in range(30)}
    path = Path(tempfile.mkdtemp(prefix="bundle-")) / "karma.tar"
    path.write_bytes(pack(parts))
    return path


FAULTS: dict[str, Callable[[Path, random.Random], None]] = {
    "recording killed": _killed_recording,
    "worker killed": _killed_worker,
    "recording, disk full": _recording_on_full_disk,
    "output, disk full": _output_on_full_disk,
    "output, folder read-only": _output_where_nothing_may_be_written,
    "run, folder read-only": _run_where_nothing_may_be_written,
    "run, few descriptors": _run_of_few_descriptors,
    "command, little memory": _little_memory,
    "two runs at once": _two_runs,
}
