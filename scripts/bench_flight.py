"""Throughput of a hosted run with 1, 2, 4, 8 requests in flight: episodes, servers, and both.

    python scripts/bench_flight.py [--threads N]        # after `make server`

Three tables of requests per second, all with the same requests, those of the shipped nano planner
on tasks of `eval/alfred_l`; the reference is one in flight:

* stand-in: `karma eval --workers N` against a server of our own that gives the answers of a
  recording, each after a fixed time, however many are asked for: what our side allows;
* server: the recording's requests sent again to a llama-server with eight slots by N threads and
  nothing else: what that server allows on this machine;
* run: `karma eval --workers N` against that server.

Every run is recorded, and its requests are counted as they come to the cassette: from when every
worker has an episode until the last episode begins, so that all are at work. "CPU" is what our
process took per request, where it is one.
"""

import json
import os
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from measuring import CHILDREN, table, taken
from support.hosted_server import NANO, free_port, real_server, wire_server

from karma.bench.engine.run import Run
from karma.files import to_json
from karma.plugins.hosted.cassette import FILE, Cassette, canonical, key_of

TASKS = Path("eval/alfred_l/tasks.jsonl")
SLOTS = 8
EXPERIMENT = """
name = "flight"
tasks = "{tasks}"
only = {only}
[models]
planner = "openai"
profile = "compact"
[models.hosted.planner]
base_url = "{url}"
model = "tiny"
api = "completions"
"""


def experiment(folder: Path, url: str, tasks: int, *, rows: int) -> Path:
    """Write the experiment; its rows are equal."""
    lines = TASKS.read_text().splitlines()
    only = json.dumps([json.loads(line)["id"] for line in lines[:tasks]])
    text = EXPERIMENT.format(tasks=TASKS.resolve(), only=only, url=url)
    text += "".join(f'[[rows]]\nname = "row {number}"\n' for number in range(rows))
    path = folder / f"{rows}.toml"
    path.write_text(text)
    return path


def run(path: Path, out: Path, workers: int, tape: Path | None = None) -> tuple[float, Any]:
    """Do an experiment; returns requests per second, and with one worker CPU ms of each."""
    tape = tape or out.with_suffix(".tape")
    asked, begun, over = list[float](), list[float](), threading.Event()
    watch = threading.Thread(target=stamp, args=(tape / FILE, asked, begun, over), daemon=True)
    watch.start()
    made = Run(path, out, cassette=Cassette(tape, "record"), steps=False)
    cpu_s = 0.0
    for number, record in enumerate(made.episodes(workers)):
        cpu_s = cpu_s if number else time.process_time()
        if record.error:
            raise SystemExit(f"{record.task}: {record.error}")
    over.set()
    watch.join()
    many = sum(len(part.answers) for record in made.records for part in record.subtasks)
    cpu_ms = 1000 * (time.process_time() - cpu_s) / many
    first, last = begun[workers - 1], begun[-1]
    rate = sum(first < moment <= last for moment in asked) / (last - first)
    return rate, cpu_ms if workers == 1 else None


def stamp(path: Path, asked: list[float], begun: list[float], over: threading.Event) -> None:
    """Note when answers of the planner and beginnings of episodes come to a cassette."""
    seen = 0
    while not over.wait(0.02):
        if path.exists():
            with path.open("rb") as file:
                file.seek(seen)
                data = file.read()
            data = data[: data.rfind(b"\n") + 1]
            seen += len(data)
            asked += [time.perf_counter()] * data.count(b'"prompt":')
            begun += [time.perf_counter()] * data.count(b'"type":"Begin"')


def exchanges(tape: Path) -> list[dict[str, Any]]:
    """Return what was recorded."""
    lines = map(json.loads, (tape / FILE).read_text().splitlines())
    return [line for line in lines if line["type"] == "Exchange"]


def ask_all(url: str, requests: Sequence[Mapping[str, Any]], threads: int) -> float:
    """Send requests with so many in flight; returns how many were answered per second."""

    def ask(one: Mapping[str, Any]) -> None:
        body = to_json({name: value for name, value in one.items() if name != "path"})
        head = {"Content-Type": "application/json"}
        urllib.request.urlopen(urllib.request.Request(url + one["path"], body, head)).read()

    with ThreadPoolExecutor(threads) as pool:
        seconds = taken(lambda: list(pool.map(ask, requests)), time.perf_counter)
    return len(requests) / seconds


@contextmanager
def stand_in(tape: Path, service_s: float) -> Iterator[str]:
    """Start the stand-in in a process of its own; yields its base URL."""
    port = free_port()
    command = [sys.executable, __file__, "--stand-in", f"{port} {service_s} {tape}"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=CHILDREN)
    try:
        assert process.stdout is not None
        yield process.stdout.readline().strip()
    finally:
        process.kill()
        process.wait()


def serve(port: int, service_s: float, tape: Path) -> None:
    """Give the recorded answers, each after a fixed time."""
    known = {line["key"]: line["reply"]["answer"] for line in exchanges(tape)}

    def told(request: dict[str, Any]) -> Any:
        name = request["path"].removeprefix("/v1")
        request["path"] = name if name != request["path"] else f"..{name}"
        return known.get(key_of(canonical(request)))

    def answer(path: str, body: dict[str, Any], _: Any) -> tuple[int, dict[str, str], bytes]:
        threading.Event().wait(service_s)
        found = told({"path": path, **body})
        return (404 if found is None else 200), {}, to_json(found)

    gets = ("/v1/models", "/health", "/props", "/slots")
    pages = {path: told({"method": "GET", "path": path}) for path in gets}
    with wire_server(answer, port=port, pages=pages) as (url, _):
        print(url, flush=True)
        threading.Event().wait()


def main(
    threads: Annotated[int, typer.Option(help="Of the llama-server.")] = os.cpu_count() or 1,
    tasks: int = 16,
    rows: Annotated[int, typer.Option(help="With the stand-in, as they repeat.")] = 3,
    service_s: Annotated[float, typer.Option(help="Of the stand-in.")] = 0.2,
    most: Annotated[int, typer.Option(help="Requests in flight.")] = SLOTS,
    stand_in_for: Annotated[str, typer.Option("--stand-in", hidden=True)] = "",
) -> None:
    """Print the three tables."""
    if stand_in_for:
        port, service, tape = stand_in_for.split(" ", 2)
        serve(int(port), float(service), Path(tape))
    numbers = [number for number in (1, 2, 4, 8) if number <= most]

    def measured(name: str, measure: Callable[[int], tuple[float, Any]]) -> Iterator[Any]:
        first = 0.0
        for number in numbers:
            rate, cpu_ms = measure(number)
            first = first or rate
            yield name, number, rate, rate / first, cpu_ms

    def all_rows(folder: Path) -> Iterator[Any]:
        tape, more = folder / "tape", ("--threads", threads)
        with real_server(NANO, folder, slots=SLOTS, more=more) as url:
            path = experiment(folder, url, tasks, rows=1)
            run(path, folder / "first", 1, tape)
            with stand_in(tape, service_s) as other:
                path = experiment(folder, other, tasks, rows=rows)
                yield from measured("stand-in", lambda n: run(path, folder / f"in-{n}", n))
            asked = [line["request"] for line in exchanges(tape) if line["scope"]]
            again = [one for one in asked if one.get("path") == "/completions"]
            yield from measured("server", lambda n: (ask_all(url, again, n), None))
            path = experiment(folder, url, tasks, rows=1)
            yield from measured("run", lambda n: run(path, folder / f"run-{n}", n))

    print(f"load of the machine: {os.getloadavg()[0]:.1f}, cores {os.cpu_count()}")
    with tempfile.TemporaryDirectory(prefix="flight-") as name:
        table(
            "against | in flight | requests/s | of one in flight | CPU ms a request",
            all_rows(Path(name)),
        )


if __name__ == "__main__":
    typer.run(main)
