"""A planner that can read: it mends a failed program by what the prompt says, no more."""

import re

from karma.contracts import Completion

CALL = re.compile(r"[A-Z]\w+\(robot, '[^']+'(?:, '[^']+')?\)")
MARK = "  # FAILED: "


class ReadingPlanner:
    """A `LanguageModel`: its first program is given, each next one is read out of the prompt.

    Args:
        first: its first program of each instruction, or how to write one from the prompt.
        repair: how a program is mended, from `Failed` to lines; it raises when the prompt lacks it.

    Attributes:
        prompts: what it was told, the changing part after the stable one.
    """

    name = "reading"

    def __init__(self, *first, repair=None):
        self._first = list(first)
        self._repair = repair or do_what_it_says
        self.prompts = []

    def complete(self, prompt, *, spec=None, **drawn):
        text = prompt.stable + prompt.changing
        self.prompts.append(text)
        assert "|" not in text, "an object id in the prompt"
        if "# Your last program failed" in text:
            program = "\n".join(self._repair(Failed(text)))
        else:
            first = self._first.pop(0)
            program = first if isinstance(first, str) else first(text)
        return Completion(
            text=program, finish="stop", prompt_tokens=None, reused_tokens=None,
            completion_tokens=None, first_token_s=None, total_s=0.0,
        )  # fmt: skip


class Failed:
    """What a prompt says of the last program: what is done, what failed and why, what is left."""

    def __init__(self, text):
        self.text = text
        body = text.partition("# Your last program failed\n")[2].partition("\n# ")[0]
        lines = body.splitlines()
        (number,) = [n for n, line in enumerate(lines) if MARK in line]
        self.before = [call_of(line) for line in lines[:number]]
        self.call, self.reason = lines[number].split(MARK, 1)
        self.rest = [call_of(line) for line in lines[number + 1 :]]
        self.ran = all(line.endswith("  # done") for line in lines[:number])
        assert self.ran or all(line.endswith("  # not run") for line in lines[:number])
        assert all(line.endswith("  # not run") for line in lines[number + 1 :])


def call_of(line):
    return line.partition("  #")[0]


def do_what_it_says(failed):
    """Do the first call that the refusal names, then the failed line again, then what is left."""
    remedy = CALL.search(failed.reason)
    assert remedy, f"no remedy in: {failed.reason}"
    return [remedy[0], failed.call, *failed.rest]


def section(text, title):
    """Return the lines of a prompt below a heading."""
    return text.partition(f"# {title}")[2].partition("\n# ")[0].splitlines()[1:]


def furniture(text):
    """Return name -> (x, y, z) of the map's furniture."""
    pattern = r"(\w+)\((-?[\d.]+),(-?[\d.]+),(-?[\d.]+)\)"
    found = re.findall(pattern, "\n".join(section(text, "Long-term memory")))
    return {name: tuple(map(float, point)) for name, *point in found}
