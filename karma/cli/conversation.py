"""A conversation in the terminal: replies in colours, and commands that begin with a slash."""

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, suppress
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

CODES: Mapping[str, int] = {
    "done": DONE, "partly": UNFINISHED, "unfinished": UNFINISHED, "refused": REFUSED,
    "asked": ASKED, "answered": DONE,
}  # fmt: skip
_WORST = (STOPPED, FAILED, UNFINISHED, ASKED, REFUSED)  # the exit code of several requests
_STYLES = {
    "said": "bold", "meant": "cyan", "sure": "dim", "asked": "yellow", "did": "green",
    "failed": "red", "seen": "green", "not seen": "yellow",
}  # fmt: skip
_HELP = """\
Say what to do, in plain words, or ask: where is the mug? is the fridge open? how many
apples are there? what is in the fridge? did you wash the mug? what did you do? Tell me
what is so (the keys are in the drawer), and what I am never to do. Or:
  /look     look for what I was asked and have not seen
  /memory   what I remember of objects (short-term memory)
  /map      what I know of the room (long-term memory)
  /undo     go back to before the last thing I did: room, memory and records
  /why      what I went by: memory, program, the result of each step
  /help     this
  /quit     end; Ctrl-D does the same, Ctrl-C stops what I am doing"""


def say(agent: "Agent", instruction: str, view: AnswerView | None = None) -> "AgentReply":
    """Carry out an instruction in view: print what was understood before it is done.

    `view` hears the agent's answers, and shows them while they come.
    """
    from karma.assistant import replies
    from karma.assistant.replies import Line, RequestReply, Understanding
    from karma.types.events import Plan, SkillResult

    number, printed = 1, False
    view = view or AnswerView()
    with console.status("thinking ...") as status, closing(agent.doing(instruction)) as moments:
        view.request(status)
        for moment in moments:
            if isinstance(moment, SkillResult):
                status.update(escape(f"{moment.call} ..."))
            elif isinstance(moment, Plan):
                view.answered()
            else:
                if not printed:
                    show_lines([Line("said", f"{number}. {moment.instruction}")])
                if isinstance(moment, Understanding):
                    show_lines((replies.lines_again if printed else replies.lines_before)(moment))
                printed = isinstance(moment, Understanding)
                if isinstance(moment, RequestReply):
                    show_lines(replies.lines_after(moment))
                    number += 1
                    view.request(status)
    return agent.replies[-1]


def show_lines(lines: Sequence["Line"]) -> None:
    """Print lines of a reply in the colours of their marks."""
    for line in lines:
        tell(line.text, style=_STYLES[line.mark])


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

    Returns the exit code: for piped input the worst of all requests.
    """
    codes: list[int] = []
    at_terminal = sys.stdin.isatty()
    for line in (*agent.home.greeting(), f"{agent.map.lines()[0]}. Say what to do, or /help."):
        tell(line)
    try:
        for typed in _typed(at_terminal=at_terminal):
            if typed.split()[0] == "/quit":
                break
            resolved = agent.assistant.resolve(typed, at_terminal=at_terminal)
            if resolved.note:
                tell(resolved.note, style="dim")
            if resolved.text:
                codes.append(_answered(agent, resolved.text, view))
            if codes[-1:] == [STOPPED] and not at_terminal:
                break
    except KeyboardInterrupt:
        codes.append(STOPPED)
    if agent.replies:
        show_folder(agent)
    return DONE if at_terminal else next((code for code in _WORST if code in codes), DONE)


def _answered(agent: "Agent", typed: str, view: AnswerView | None) -> int:
    """Do what was typed; return its exit code."""
    replies_before = len(agent.replies)
    try:
        if typed.startswith("/"):
            _command(agent, typed.split()[0])
            return DONE
        return CODES[say(agent, typed, view).status]
    except KeyboardInterrupt:
        tell_stopped(agent, replies_before)
        return STOPPED
    except KarmaError as error:
        tell(f"error: {error}", style="red")
        return FAILED


def tell_stopped(agent: "Agent", replies_before: int) -> None:
    """Say what was stopped."""
    if len(agent.replies) == replies_before:
        text = "stopped; all is as it was before you said that"
    else:
        text = f"stopped: {agent.replies[-1].stopped}; what was done before it is kept"
    tell(text, style="yellow")


def _typed(*, at_terminal: bool) -> Iterator[str]:
    """Yield what is typed, without blank lines; Ctrl-D, and Ctrl-C at the prompt, end it.

    Raises:
        KeyboardInterrupt: it was stopped, and nobody types.
    """
    if at_terminal:
        with suppress(ImportError):
            import readline  # noqa: F401  `input` then knows arrow keys and earlier lines
    while True:
        try:
            line = readable(input("> " if at_terminal else "")).lstrip("\ufeff").strip()
        except EOFError:
            console.print()
            return
        except KeyboardInterrupt:
            console.print()
            if at_terminal:
                return
            raise
        if line:
            if not at_terminal:
                tell(f"> {line}")
            yield line


def _command(agent: "Agent", name: str) -> None:
    """Do what begins with a slash."""
    match name:
        case "/memory":
            tell("\n".join(agent.memory.lines()))
        case "/map":
            tell("\n".join(agent.map.lines()))
        case "/help":
            tell(_HELP)
        case "/look":
            tell("you have asked for nothing that I have not seen")
        case "/undo":
            undone = agent.undo()
            tell("nothing to undo" if undone is None else f"undone: {undone}")
        case "/why":
            from karma.assistant.replies import lines_why

            parts = agent.replies[-1].parts if agent.replies else ()
            if not parts:
                tell("nothing was said yet")
            for part in parts:
                show_lines(lines_why(part))
        case _:
            tell("there is no such command; /help lists them", style="yellow")
