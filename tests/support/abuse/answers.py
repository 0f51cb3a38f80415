"""Planners' answers that mean harm: into the parser, and on into records, terminal and page."""

import io
import random
from collections.abc import Iterator
from contextlib import redirect_stderr
from pathlib import Path

from karma.agent.planning.program import MAX_CHARACTERS, MAX_LINES, parse_program, parse_refusal
from karma.agent.planning.recovery import recover_program
from karma.errors import ProgramError
from karma.files import to_json
from support.abuse import Case, stream

MARKUP = ("[/red]", "[link=http://127.0.0.1:9/x]here[/link]", "[bold", "[red]x", "\\[", "[[/]]")
ESCAPES = (
    "\x1b[2J\x1b[H", "\x1b]0;owned\x07", "\x1b]8;;http://127.0.0.1:9\x1b\\x", "\x9b31m", "\x07\x08",
    "\u202etxt.exe", "\u2066\u2069", "\x1bP+q544e\x1b\\", "\r\rgone", "\x00", "\x7f",
)  # fmt: skip
HTML = ("<script>owned()</script>", "</script><img src=x onerror=owned()>", "<!--", "&lt;", "]]>")
TEMPLATES = (
    "{{ 7 * 7 }}",
    "{% for x in ().__class__.__bases__ %}",
    "${7*7}",
    "{0.__class__}",
    "%n",
)
BAD = (*MARKUP, *ESCAPES, *HTML, *TEMPLATES, "../../etc/x", "A" * 500, "\ud800", "аррӏе", "🍎" * 50)
_NUMBERS = ("1" + "0" * 400, "1e999", "-1e308", "9" * 4000, "0x" + "f" * 300, "nan", "True", "1j")


def _bombs(rng: random.Random) -> Iterator[str]:
    """Yield one text of each kind of bomb."""
    deep, many = rng.randrange(50, 6000), rng.randrange(10, 4000)
    bad, number = rng.choice(BAD), rng.choice(_NUMBERS)
    yield "(" * deep + ")" * deep
    yield "-" * deep + "1"
    yield "[" * deep + "]" * deep
    yield "{" * deep
    yield f"GoToObject(robot, {'[' * deep}'Apple'{']' * deep})"
    yield "not " * deep + "x"
    yield ".".join("x" * deep)
    yield "lambda:" * deep + "0"
    yield "x = " * deep + "1"
    yield f"GoToObject(robot, {' + '.join(repr('a') for _ in range(many))})"
    yield f"Explore(robot, 'Apple', [({number}, 0, {number})])"
    yield f"Explore(robot, 'Apple', [{', '.join(['(0, 0, 0)'] * many)}])"
    yield f"GoToObject(robot, {number})"
    yield f"GoToObject(robot, {bad!r})"
    yield f"GoToObject(robot, '{bad}')"
    yield f"{bad}(robot, 'Apple')"
    yield bad * rng.randrange(1, 50)
    yield f"refuse({bad!r})"
    yield f"refuse('{'thing' * many}')"
    yield "GoToObject(robot, 'Apple')\n" * rng.choice((MAX_LINES, MAX_LINES + 1, 5000))
    yield "x" * rng.choice((MAX_CHARACTERS, MAX_CHARACTERS + 1, 3_000_000))
    yield "#" + bad * many
    yield "__import__('os').system('true')"
    yield f"GoToObject(robot, *[{deep}])\nPickupObject(**{{}})"
    yield "f'{__import__(\"os\")}'\n" + "\t \x0c" * many
    yield "\r".join(["GoToObject(robot, 'Apple')"] * 3) + "\x1a"
    yield "```python\n" * rng.randrange(1, 100)
    yield f"'''{bad}" * rng.randrange(1, 9)
    yield "ＧoToObject(robot, 'Apple')\nGoToObject(rοbot, 'Apple')"
    yield f"GoToObject(robot, 'Apple'){';' * rng.randrange(1, 9)}GoToObject(robot, 'Mug')"
    yield "\\\n" * many + "1"
    yield bytes(rng.randrange(256) for _ in range(300)).decode("latin-1")
    yield "".join(chr(rng.randrange(1, 0x2FFF)) for _ in range(200))
    yield f"with {bad!r} as x: pass\nwhile 1: pass\nimport os\nexec({bad!r})"


def hostile_texts(seed: int, count: int) -> list[str]:
    """Return so many answers, the same for a seed."""
    rng = stream(seed, "answers")
    found: list[str] = []
    while len(found) < count:
        found += _bombs(rng)
    return found[:count]


def answers(seed: int, count: int) -> Iterator[Case]:
    """Yield answers that the parser reads as data or refuses with a quotable line."""
    for number, text in enumerate(hostile_texts(seed, count)):
        yield Case(name=f"answer {number}: {text[:40]!a}", attack=lambda _, t=text: _parsed(t))


def _parsed(text: str) -> None:
    for read in (parse_program, recover_program):
        try:
            read(text)
        except ProgramError as error:
            assert len(str(error)) < 1000
            to_json(str(error).encode(errors="replace").decode())
    parse_refusal(text)


# ----------------------------------------------------------------- shown and written


def showing(seed: int, count: int) -> Iterator[Case]:
    """Yield texts as names, ids, notes and reasons, in the terminal and on the page."""
    rng = stream(seed, "showing")
    for number in range(count):
        bad = rng.choice(BAD) + rng.choice(("", "x", rng.choice(BAD)))
        bad = bad.encode(errors="replace").decode()
        show = rng.choice((_in_tables, _in_an_error, _as_lines, _in_a_page))
        yield Case(name=f"{show.__name__} {number}: {bad[:40]!a}", attack=_shown(show, bad))


def _shown(show, bad):
    return lambda folder: show(bad, folder)


def _in_tables(bad: str, folder: Path) -> None:
    from karma.bench.figures.columns import figures
    from karma.cli import show
    from support.made_records import episode, sub

    records = [episode(sub("OPEN(Fridge): 1"), row=bad, task=bad)]
    for one in (
        show.task_table(records),
        show.summary_table(figures(records), bad),
    ):
        steers_nothing(_printed(one), bad)


def _in_an_error(bad: str, folder: Path) -> None:
    import typer

    from karma.cli import shared
    from karma.errors import FileError

    @shared.clear_errors
    def command() -> None:
        raise FileError(bad, bad, fix=bad)

    said = io.StringIO()
    try:
        with redirect_stderr(said):
            command()
    except typer.Exit as error:
        assert error.exit_code == 1
    steers_nothing(said.getvalue(), bad)


def _as_lines(bad: str, folder: Path) -> None:
    from rich.markup import escape
    from rich.text import Text

    steers_nothing(_printed(escape(bad)), bad)
    steers_nothing(_printed(Text(bad)), bad)


def _in_a_page(bad: str, folder: Path) -> None:
    from karma.bench.figures.results import result_of
    from karma.bench.report.page import render
    from karma.journal.run_folder import read_run
    from support.made_records import episode, sub, write_run

    found = episode(sub("OPEN(Fridge): 1", instruction=bad), row=bad, task=bad, error=bad)
    run = read_run(write_run(folder / "run", [found], name=bad))
    page = render(run, result_of(run, {}), [])
    assert "<script" not in page
    assert "<img src=x" not in page
    assert 'href="http' not in page


def _printed(what: object) -> str:
    from karma.cli.shared import SafeConsole

    file = io.StringIO()
    SafeConsole(file=file, force_terminal=True, width=200, color_system=None).print(what)
    return file.getvalue()


def steers_nothing(shown: str, bad: str) -> None:
    """See that a terminal would show a text and do nothing that the text says."""
    assert not set(shown) & set("\x1b\x9b\x07\x08\x00\x7f\u202e\u2066\u2069\r"), ascii(shown)[:200]
    assert ("[link=" in bad) <= ("[link=" in "".join(shown.split())), "markup was obeyed"
