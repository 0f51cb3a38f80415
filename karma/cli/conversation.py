"""A conversation in the terminal: what an agent says in colours, and what begins with a slash."""

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.markup import escape

from karma.cli.progress import AnswerView
from karma.cli.shared import (
    ASKED,
    DONE,
    FAILED,
    REFUSED,
    STOPPED,
    UNFINISHED,
    console,
    readable,
    tell,
)
from karma.errors import KarmaError

if TYPE_CHECKING:
    from karma.assistant.agent import Agent
    from karma.assistant.replies import AgentReply, Line

_ALL = 10_000  # rows of an answer where no screen ends
CODES: Mapping[str, int] = {
    "done": DONE, "partly": UNFINISHED, "unfinished": UNFINISHED, "refused": REFUSED,
    "asked": ASKED, "answered": DONE,
}  # fmt: skip
_WORST = (STOPPED, FAILED, UNFINISHED, ASKED, REFUSED)  # of several requests the first of these
_MOST, _SHOWN = 10_000, 1_000  # characters of a line that are read; of it, that are shown
TYPED, _KEPT = "typed.txt", 500  # what was typed in a home, and how many lines of it
_STYLES = {
    "said": "bold", "meant": "cyan", "sure": "dim", "asked": "yellow", "did": "green",
    "failed": "red", "seen": "green", "not seen": "yellow",
}  # fmt: skip
_HELP = (
    "Say what to do, in plain words, or ask: where is the mug? is the fridge open? how many",
    "apples are there? what is in the fridge? did you wash the mug? what did you do? Tell me",
    "what is so (the keys are in the drawer), and what I am never to do. Or:",
    "  /look     look for what I was asked and have not seen",
    "  /memory   what I remember of things (short-term memory)",
    "  /map      what I know of the room (long-term memory)",
    "  /undo     go back to before the last thing I did: room, memory and records",
    "  /why      what I went by: memory, program, what came of each step",
    "  /help     this",
    "  /quit     end; Ctrl-D does the same, Ctrl-C stops what I am doing",
)


def say(agent: "Agent", instruction: str, view: AnswerView | None = None) -> "AgentReply":
    """Have something carried out in view; what was understood is printed before it is done.

    `view` hears the agent's answers, and shows them while they come.
    """
    from karma.assistant import replies
    from karma.assistant.replies import Line, RequestReply, Understanding
    from karma.types.events import Plan, SkillResult

    most = replies.rows_for(len(agent.clauses(instruction))) if _watched() else _ALL
    number, printed = 0, 0
    view = view or AnswerView()
    with console.status("thinking ...") as status, closing(agent.doing(instruction)) as moments:
        view.request(status)
        for moment in moments:
            if isinstance(moment, SkillResult):
                status.update(escape(f"{moment.call} ..."))
            elif isinstance(moment, Plan):
                view.answered(moment)
            elif isinstance(moment, Understanding | RequestReply):
                view.ended()  # it is understood before its plan comes
                if isinstance(moment, RequestReply):
                    lines = replies.lines_after(moment, max(most - printed, 1))
                elif printed:
                    lines = replies.lines_again(moment)
                else:
                    lines = replies.lines_before(moment, max(most // 2, 1))
                if not printed:
                    lines.insert(0, Line("said", f"{number + 1}. {moment.instruction}"))
                show_lines(lines)
                printed += len(lines)
                if isinstance(moment, RequestReply):
                    number, printed = number + 1, 0
                    view.request(status)
    return agent.replies[-1]


def _watched() -> bool:
    """Return whether lines go to a screen, which ends, and not to a file or another program."""
    return console.is_terminal


def show_lines(lines: Sequence["Line"]) -> None:
    """Print lines of an answer, each in one row; whole where no screen ends."""
    for line in lines:
        _in_one_row(line.text, _STYLES[line.mark])


def _in_one_row(text: str, style: str = "") -> None:
    cut: dict[str, Any] = {"no_wrap": True, "overflow": "ellipsis"}
    how = cut if _watched() else {"soft_wrap": True}
    console.print(escape(text), style=style, highlight=False, **how)


def figures_of(agent: "Agent", reply: "AgentReply") -> Mapping[str, Any]:
    """Return what `--json` keeps of an agent's reply."""
    return {
        "status": reply.status,
        "exit_code": CODES[reply.status],
        "finished": bool(reply),
        "scene": agent.scene.name,
        "run": str(agent.folder),
        "hosted": reply.spent,
        "instructions": [
            {
                "instruction": part.instruction,
                "answers": part.record.answers if part.record else (),
                "calls": part.record.calls if part.record else (),
                "understood": part.understood[:1],
                "afterwards": part.checks,
                **({"refused": part.refused} if part.refused else {}),
            }
            for part in reply.parts
        ],
    }


def show_folder(agent: "Agent") -> None:
    """Say where the run is, if there is one, and what makes a page of it."""
    if agent.has_run:
        tell(f"run: {agent.folder} (karma report {agent.folder})")


# ----------------------------------------------------------------- the conversation


def converse(agent: "Agent", view: AnswerView | None = None) -> int:
    """Take what is typed, or piped in, until it ends; `view` as in `say`.

    Returns the exit code: of what was piped in the worst that came of a request.
    """
    codes: list[int] = []
    for line in (*agent.home.greeting(), f"{agent.map.lines()[0]}. Say what to do, or /help."):
        tell(line)
    try:
        for typed in _typed(agent.home.folder):
            if typed.split()[0] == "/quit":
                break
            resolved = agent.assistant.resolve(typed, at_terminal=sys.stdin.isatty())
            if resolved.note:
                tell(resolved.note, style="dim")
            if resolved.text:
                codes.append(_answered(agent, resolved.text, view))
            if codes[-1:] == [STOPPED] and not sys.stdin.isatty():
                break
    except KeyboardInterrupt:
        codes.append(STOPPED)
    if agent.replies:
        show_folder(agent)
    if sys.stdin.isatty():
        return DONE
    return next((one for one in _WORST if one in codes), DONE)


def _answered(agent: "Agent", typed: str, view: AnswerView | None) -> int:
    """Do what was typed; return its exit code."""
    said = len(agent.replies)
    try:
        if typed.startswith("/"):
            _command(agent, typed.split()[0])
            return DONE
        return CODES[say(agent, typed, view).status]
    except KeyboardInterrupt:
        tell_stopped(agent, said)
        return STOPPED
    except KarmaError as error:
        tell(f"error: {error}", style="red")
        return FAILED


def tell_stopped(agent: "Agent", said: int) -> None:
    """Say what was stopped; `said`: how many replies there were before."""
    if len(agent.replies) == said:
        told = "stopped; all is as it was before you said that"
    else:
        told = f"stopped: {agent.replies[-1].stopped}; what was done before it is kept"
    tell(told, style="yellow")


def _typed(home: Path | None = None) -> Iterator[str]:
    """Yield what is typed, without blank lines; Ctrl-D, and Ctrl-C at the prompt, end it.

    The folder of the home keeps what was typed for the arrow keys.

    Raises:
        KeyboardInterrupt: it was stopped, and nobody types.
    """
    if not sys.stdin.isatty():
        yield from _lines(asks=False)
        return
    try:
        import readline  # with it `input` knows arrow keys, and what was typed before
    except ImportError:
        yield from _lines(asks=True)
        return
    kept = None if home is None else home / TYPED
    readline.clear_history()
    readline.set_history_length(_KEPT)
    with suppress(OSError):
        if kept is not None:
            kept.touch()
            readline.read_history_file(kept)
    for line in _lines(asks=True):
        yield line
        with suppress(OSError):  # whoever cannot write it types on
            if kept is not None:
                readline.append_history_file(1, kept)


def _lines(*, asks: bool) -> Iterator[str]:
    while True:
        try:
            line = readable(input("> ") if asks else _line())
        except EOFError:
            console.print()
            return
        except KeyboardInterrupt:
            console.print()
            if not asks:  # whatever sent it, it was meant for all that is left
                raise
            return
        if not asks and not line:
            return
        if not asks and line.strip():
            tell(f"> {line.strip()[:_SHOWN]}")
        if line.strip():
            yield line.strip()


def _line() -> str:
    """Return a line of what is piped in, "" at the end; of one without end no more than a part."""
    line = rest = sys.stdin.readline(_MOST)
    while rest and not rest.endswith("\n"):
        rest = sys.stdin.readline(_MOST)
    return line.lstrip("\ufeff")


def _command(agent: "Agent", name: str) -> None:
    """Do what begins with a slash."""
    match name:
        case "/memory":
            _print_plainly(agent.memory.lines())
        case "/map":
            _print_plainly(agent.map.lines())
        case "/help":
            _print_plainly(_HELP)
        case "/look":
            console.print("you have asked for nothing that I have not seen")
        case "/undo":
            undone = agent.undo()
            console.print("nothing to undo" if undone is None else escape(f"undone: {undone}"))
        case "/why":
            _why(agent)
        case _:
            console.print("there is no such command; /help lists them", style="yellow")


def _print_plainly(lines: Sequence[str]) -> None:
    from karma.assistant.replies import ROWS

    most = ROWS if _watched() else _ALL
    shown = list(lines[:most])
    if len(lines) > most:
        shown[-1] = f"  and {len(lines) - most + 1} more"
    for line in shown:
        _in_one_row(line)


def _why(agent: "Agent") -> None:
    from karma.assistant.replies import lines_why, rows_for

    parts = agent.replies[-1].parts if agent.replies else ()
    if not parts:
        console.print("nothing was said yet")
    for part in parts:
        show_lines(lines_why(part, rows_for(len(parts))))
