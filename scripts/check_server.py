"""Ask llama.cpp's own server for programs under a grammar, and count what is none.

The model has random weights (`karma.testing`): left alone it babbles, so what reads as a program
is the grammar's doing. Every answer is read by the automaton that holds local models.

    python scripts/check_server.py --programs 10000        # after `make server`
    python scripts/check_server.py --base-url http://127.0.0.1:8080/v1 --model NAME

Exit status 1 where an answer was no program.
"""

import argparse
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

from karma.agent.program import SKILLS, parse_program
from karma.contracts import Completion, LanguageModel, ProgramSpec, Prompt
from karma.errors import KarmaError, ProgramError
from karma.household.types import object_types
from karma.infer.hosted.planner import open_planner
from karma.infer.hosted.session import Endpoint
from karma.infer.programs.automaton import ProgramAutomaton
from karma.testing import make_planner

ROOT = Path(__file__).parent.parent
PROMPT = Prompt(stable="You plan for a robot.\n", changing="Wash the mug.\n")
SPEC = ProgramSpec(
    skills=SKILLS,
    objects=tuple(sorted(object_types())),
    positions=tuple(f"node_{number}" for number in range(1, 13)),
    max_calls=3,
)
AUTOMATON = ProgramAutomaton(SPEC)
NAME = "random"
STARTS_S = 120.0


def main() -> None:
    """Start a server unless one is named, ask it, and say what came back."""
    arguments = _arguments()
    with _server(arguments) as place:
        begun = time.perf_counter()
        open_planner(place, constrained=True)
        print(f"canary: passed in {time.perf_counter() - begun:.1f} s")
        begun = time.perf_counter()
        answers = _asked(place, arguments.programs, arguments.slots)
        seconds = time.perf_counter() - begun
        free = _asked(place, min(100, arguments.programs), arguments.slots, bound=False)
    verdicts = Counter(map(_verdict, answers))
    tokens = sum(answer.completion_tokens or 0 for answer in answers)
    print(
        f"{len(answers)} answers under the grammar: {verdicts['legal']} legal programs"
        f" ({len({answer.text for answer in answers})} different), {verdicts['illegal']} illegal,"
        f" {verdicts['cut']} cut, {seconds:.0f} s, {tokens / seconds:.0f} tokens/s,"
        f" {arguments.slots} in flight"
    )
    legal = sum(_verdict(answer) == "legal" for answer in free)
    print(f"{len(free)} answers of the same model without it: {legal} legal programs")
    sys.exit(verdicts["legal"] < len(answers))


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--programs", type=int, default=1000)
    parser.add_argument("--slots", type=int, default=8, help="requests in flight")
    parser.add_argument("--family", default="llama3", help="of the made model")
    parser.add_argument("--base-url", default="", help="of a server that runs already")
    parser.add_argument("--model", default=NAME, help="its model's name")
    return parser.parse_args()


def _asked(place: Endpoint, programs: int, slots: int, *, bound: bool = True) -> list[Completion]:
    """Return answers, seed by seed; each line of requests has a session of its own."""

    def line(first: int) -> list[Completion]:
        model: LanguageModel = open_planner(place)
        spec = SPEC if bound else None
        return [
            model.complete(PROMPT, spec=spec, max_tokens=400, temperature=1.5, seed=seed)
            for seed in range(first, programs, slots)
        ]

    with ThreadPoolExecutor(slots) as pool:
        return [answer for answers in pool.map(line, range(slots)) for answer in answers]


def _verdict(answer: Completion) -> str:
    """Return "legal" for what automaton and parser both take for a program."""
    if answer.finish == "length":
        return "cut"
    state = AUTOMATON.advance(AUTOMATON.start(), answer.text)
    try:
        calls = parse_program(answer.text)
    except ProgramError:
        return "illegal"
    return "legal" if calls and state is not None and AUTOMATON.accepts(state) else "illegal"


@contextmanager
def _server(arguments: argparse.Namespace) -> Iterator[Endpoint]:
    if arguments.base_url:
        yield Endpoint(base_url=arguments.base_url, model=arguments.model)
        return
    program = subprocess.run(
        ["bash", str(ROOT / "scripts/build_llama_server.sh"), "--where"],
        capture_output=True, text=True, check=False,
    ).stdout.strip()  # fmt: skip
    if not program:
        sys.exit("llama.cpp's own server is not built\n  To fix: make server")
    with tempfile.TemporaryDirectory() as folder, socket.socket() as free:
        model = make_planner(Path(folder) / "random.gguf", arguments.family)
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
        free.close()
        command = [
            program, "--model", str(model), "--alias", NAME, "--port", str(port), "--offline",
            "--parallel", str(arguments.slots), "--ctx-size", str(1024 * arguments.slots),
            "--threads", "1", "--cache-ram", "0",  # the model is tiny: threads would only wait
        ]  # fmt: skip
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            _wait(port)
            yield Endpoint(base_url=f"http://127.0.0.1:{port}/v1", model=NAME)
        finally:
            process.kill()
            process.wait()


def _wait(port: int) -> None:
    until = time.monotonic() + STARTS_S
    while time.monotonic() < until:
        try:
            urllib.request.urlopen(f"http://127.0.0.1:{port}/health", timeout=5).close()
        except OSError:
            time.sleep(0.05)
        else:
            return
    sys.exit("the server does not answer")


if __name__ == "__main__":
    try:
        main()
    except KarmaError as error:
        sys.exit(str(error))
