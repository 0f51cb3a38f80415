"""Throughput of a hosted run with 1, 2, 4, 8 requests in flight: episodes, servers, and both.

    python scripts/bench_flight.py --server $(scripts/build_llama_server.sh --where)

Three tables of requests per second, all with the same requests, those of the shipped nano planner
on tasks of `eval/alfred_l`:

* stand-in: `karma eval --workers N` against a server of our own that gives the answers of a
  recording, each after a fixed time, however many are asked for: what our side allows;
* server: the recording's requests sent again to a llama-server with eight slots by N threads and
  nothing else: what that server allows on this machine;
* run: `karma eval --workers N` against that server.

Every run is recorded, and its requests are counted as they come to the cassette: from when every
worker has an episode until the last episode begins, so that all are at work. "CPU" is what our
process took per request, where it is one.
"""

import argparse
import json
import os
import socket
import subprocess
import sys
import tempfile
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from karma.bench.run import Run
from karma.files import to_json
from karma.infer.hosted.cassette import FILE, Cassette, canonical, key_of

NANO = "models/nano/planner.gguf"
TASKS = Path("eval/alfred_l/tasks.jsonl")
SLOTS = 8
_STARTS_S = 120.0
EXPERIMENT = """
name = "flight"
tasks = "{tasks}"
only = {only}
[models]
planner = "openai"
profile = "compact"
[models.hosted.planner]
base_url = "{url}"
model = "nano"
api = "completions"
"""


def main() -> int:
    """Print the three tables; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--server", required=True, help="a llama-server")
    parser.add_argument("--threads", type=int, default=os.cpu_count(), help="of the llama-server")
    parser.add_argument("--tasks", type=int, default=16)
    parser.add_argument("--rows", type=int, default=3, help="with the stand-in, as they repeat")
    parser.add_argument("--service-s", type=float, default=0.2, help="of the stand-in")
    parser.add_argument("--in-flight", type=int, nargs="*", default=[1, 2, 4, 8])
    parser.add_argument("--stand-in", nargs=3, help=argparse.SUPPRESS)
    chosen = parser.parse_args(["--server", "", *sys.argv[1:]])
    if chosen.stand_in:
        tape, port, service_s = chosen.stand_in
        serve(Path(tape), int(port), float(service_s))
        return 0
    print(f"load of the machine before: {os.getloadavg()[0]:.1f}, cores {os.cpu_count()}")
    with tempfile.TemporaryDirectory(prefix="flight-") as name:
        folder = Path(name)
        tape = folder / "tape"
        with llama_server(chosen.server, chosen.threads, folder) as url:
            path = experiment(folder, url, chosen.tasks, rows=1)
            run(path, folder / "first", 1, tape)
            with stand_in(tape, chosen.service_s) as other:
                path = experiment(folder, other, chosen.tasks, rows=chosen.rows)
                table("stand-in", chosen.in_flight, lambda n: run(path, folder / f"in-{n}", n))
            again = requests_of(tape)
            table("server", chosen.in_flight, lambda n: (ask_all(url, again, n), None))
            path = experiment(folder, url, chosen.tasks, rows=1)
            table("run", chosen.in_flight, lambda n: run(path, folder / f"run-{n}", n))
    print(f"load of the machine after: {os.getloadavg()[0]:.1f}")
    return 0


def table(name: str, numbers: Sequence[int], measure: Any) -> None:
    """Measure with each number in flight, and print what comes of it."""
    first = None
    for number in numbers:
        rate, cpu_s = measure(number)
        first = first or rate
        cpu = "" if cpu_s is None else f", CPU {1000 * cpu_s:4.0f} ms a request"
        print(f"{name:8} {number} in flight: {rate:6.2f} requests/s, x {rate / first:.2f}{cpu}",
              flush=True)  # fmt: skip


def experiment(folder: Path, url: str, tasks: int, *, rows: int) -> Path:
    """Write the experiment; its rows are equal."""
    lines = TASKS.read_text().splitlines()
    only = json.dumps([json.loads(line)["id"] for line in lines[:tasks]])
    text = EXPERIMENT.format(tasks=TASKS.resolve(), only=only, url=url)
    text += "".join(f'[[rows]]\nname = "row {number}"\n' for number in range(rows))
    path = folder / f"{rows}.toml"
    path.write_text(text)
    return path


def run(
    path: Path, out: Path, workers: int, tape: Path | None = None
) -> tuple[float, float | None]:
    """Do an experiment; returns requests per second, and with one worker CPU seconds of each."""
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
    cpu_s = (time.process_time() - cpu_s) / many
    first, last = begun[workers - 1], begun[-1]
    rate = sum(first < moment <= last for moment in asked) / (last - first)
    return rate, cpu_s if workers == 1 else None


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


# ----------------------------------------------------------------- the real server


@contextmanager
def llama_server(program: str, threads: int, folder: Path) -> Iterator[str]:
    """Start a llama-server with the nano planner; yields its base URL."""
    port = free_port()
    command = [
        program, "-m", NANO, "--alias", "nano", "--host", "127.0.0.1", "--port", str(port),
        "-np", str(SLOTS), "-c", str(2048 * SLOTS), "-t", str(threads), "--offline",
    ]  # fmt: skip
    with (folder / "server.log").open("wb") as log:
        process = subprocess.Popen(command, stdout=log, stderr=log)
    try:
        wait_for(f"http://127.0.0.1:{port}/health")
        yield f"http://127.0.0.1:{port}/v1"
    finally:
        process.kill()
        process.wait()


def requests_of(tape: Path) -> list[dict[str, Any]]:
    """Return the planner's requests, as they were recorded."""
    lines = [json.loads(line) for line in (tape / FILE).read_text().splitlines()]
    asked = [line["request"] for line in lines if line["type"] == "Exchange" and line["scope"]]
    return [one for one in asked if one.get("path") == "/completions"]


def ask_all(url: str, requests: Sequence[Mapping[str, Any]], threads: int) -> float:
    """Send requests with so many in flight; returns how many were answered per second."""

    def ask(one: Mapping[str, Any]) -> None:
        body = to_json({name: value for name, value in one.items() if name != "path"})
        head = {"Content-Type": "application/json"}
        urllib.request.urlopen(urllib.request.Request(url + one["path"], body, head)).read()

    begun = time.perf_counter()
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(ask, requests))
    return len(requests) / (time.perf_counter() - begun)


# ----------------------------------------------------------------- the stand-in


@contextmanager
def stand_in(tape: Path, service_s: float) -> Iterator[str]:
    """Start the stand-in in a process of its own; yields its base URL."""
    port = free_port()
    command = [sys.executable, __file__, "--stand-in", str(tape), str(port), str(service_s)]
    process = subprocess.Popen(command)
    try:
        wait_for(f"http://127.0.0.1:{port}/v1/models")
        yield f"http://127.0.0.1:{port}/v1"
    finally:
        process.kill()
        process.wait()


def serve(tape: Path, port: int, service_s: float) -> None:
    """Give the recorded answers, each after a fixed time."""
    lines = [json.loads(line) for line in (tape / FILE).read_text().splitlines()]
    known = {line["key"]: line["reply"] for line in lines if line["type"] == "Exchange"}

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"
        disable_nagle_algorithm = True

        def do_GET(self) -> None:
            self._say({"method": "GET", "path": self._named()}, 0.0)

        def do_POST(self) -> None:
            body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
            self._say({"path": self._named(), **body}, service_s)

        def _named(self) -> str:
            path = self.path.removeprefix("/v1")
            return path if path != self.path else f"..{path}"

        def _say(self, request: dict[str, Any], wait_s: float) -> None:
            threading.Event().wait(wait_s)
            reply = known.get(key_of(canonical(request)), {"answer": None})
            data = to_json(reply["answer"])
            self.send_response(404 if reply["answer"] is None else 200)
            self.send_header("Content-Type", "application/json")
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            self.wfile.write(data)

        def log_message(self, *_: Any) -> None:
            pass

    ThreadingHTTPServer(("127.0.0.1", port), Handler).serve_forever()


def free_port() -> int:
    """Return a port that nobody uses."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def wait_for(url: str) -> None:
    """Wait until a server answers."""
    until = time.monotonic() + _STARTS_S
    while time.monotonic() < until:
        try:
            urllib.request.urlopen(url, timeout=5).close()
        except (urllib.error.HTTPError, OSError):
            time.sleep(0.1)
        else:
            return
    raise SystemExit(f"nothing answers at {url}")


if __name__ == "__main__":
    sys.exit(main())
