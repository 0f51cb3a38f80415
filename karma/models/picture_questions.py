"""Cut pictures, ask vision models and read their answers (KARMA §3.4, Fig. 10, appendix F)."""

import base64
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

from karma.errors import ModelError
from karma.household.pieces import base_type
from karma.types.observation import SeenObject, State
from karma.types.space import Frame

STATES: tuple[str, ...] = get_args(State)
Profile = Literal["full", "compact"]
ROLE = (
    "As an image analysis expert, your task is to infer the state of objects in the image "
    "through step-by-step reasoning."
)
_SPACES = "".join(one for one in map(chr, range(0x3001)) if one.isspace())


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """What an answer says."""

    states: Mapping[str, tuple[str, ...]]  # object id -> words, sorted; () for "none"
    unread: tuple[str, ...]  # ids of objects of interest that it says nothing usable about
    faults: tuple[str, ...]  # lines that could not be used, and why


def names_of(objects: Sequence[SeenObject]) -> dict[str, str]:
    """Return id -> the name to ask by; several of a type are numbered from left to right."""
    groups: dict[str, list[SeenObject]] = {}
    for one in objects:
        groups.setdefault(base_type(one.object_type), []).append(one)
    found = {}
    for name, group in groups.items():
        group.sort(key=lambda one: (one.region[0] if one.region else 0.0, one.object_id))
        for number, one in enumerate(group, start=1):
            found[one.object_id] = name if len(group) == 1 else f"{name} {number}"
    return found


def question(profile: Profile, instruction: str, objects: Sequence[SeenObject]) -> tuple[str, str]:
    """Return the system's and the user's text; the picture goes before the user's.

    "full" is the paper's four steps; "compact" only names the object, for models trained on nothing
    else.
    """
    names = names_of(objects)
    if profile == "compact":
        return "", ", ".join(names[one.object_id] for one in objects)
    listed = ", ".join(names[one.object_id] for one in objects)
    return ROLE, (
        "1. Provide a detailed description of this image.\n"
        f'2. From the given task "{instruction}", extract the relevant content from the first '
        f"step's image description that pertains to the mentioned objects: {listed}.\n"
        "3. Based on the object descriptions extracted in the second step, match each object to "
        f"one of the following states: {', '.join(STATES)}. If several hold, name all of them, "
        "separated by commas.\n"
        "4. Summarize the results from step three in the following format, one object per line, "
        "nothing after it:\nobject: state"
    )


def read_answer(text: str, objects: Sequence[SeenObject]) -> Reading:
    r"""Read `object: state` lines strictly; other lines are the reasoning that was asked for.

    A line counts when its name is that of an object of interest and all its words are states. The
    last line about an object holds, for it belongs to the summary. Nothing is guessed.

    >>> mug = SeenObject(object_id="Mug|1", object_type="Mug", position_m=(0, 0, 0),
    ...     box_center_m=(0, 0, 0), box_size_m=(1, 1, 1), pickupable=True)
    >>> read_answer("I see a mug.\nMug: filled, dirty", [mug]).states
    {'Mug|1': ('dirty', 'filled')}
    """
    by_name = {name.lower(): object_id for object_id, name in names_of(objects).items()}
    states: dict[str, tuple[str, ...]] = {}
    faults = []
    for number, line in enumerate(text.splitlines(), start=1):
        name, colon, words = line.partition(":")
        object_id = by_name.get(_squeezed(name.lstrip(f"{_SPACES}>*-")))
        if object_id is None or not colon or ":" in words:
            continue
        given = [_squeezed(word) for word in words.rstrip(f"{_SPACES}*.").split(",")]
        wrong = [word for word in given if word not in STATES]
        if wrong:
            faults.append(f"line {number}: {wrong[0]!r} is not a state: {line.strip()[:80]}")
            states.pop(object_id, None)
        elif "none" in given and len(given) > 1:
            faults.append(f"line {number}: none and something: {line.strip()[:80]}")
            states.pop(object_id, None)
        else:
            states[object_id] = tuple(sorted({word for word in given if word != "none"}))
    unread = tuple(one.object_id for one in objects if one.object_id not in states)
    return Reading(states=states, unread=unread, faults=tuple(faults))


def _squeezed(text: str) -> str:
    return " ".join(text.replace("*", " ").split()).lower()


def again(reading: Reading, objects: Sequence[SeenObject]) -> str:
    """Return what is said about an answer that cannot be used, or not in full.

    The names are those of the question: of two mugs the second stays the second.
    """
    names = names_of(objects)
    left = ", ".join(names[object_id] for object_id in reading.unread)
    wrong = f" These could not be used: {'; '.join(reading.faults)}." if reading.faults else ""
    return (
        f"There is no usable line about: {left}.{wrong} Answer with one line per object in the "
        "format object: state, nothing else."
    )


def states_told(
    ask: Callable[[Sequence[tuple[str, str]]], str], objects: Sequence[SeenObject], attempts: int
) -> dict[str, tuple[str, ...]]:
    """Ask until every object of interest has a usable line, or the attempts are used up.

    `ask` is given what was said after the question: (role, text) of each earlier answer and of what
    was said about it. Returns object id -> words; a later answer about an object holds.
    """
    states: dict[str, tuple[str, ...]] = {}
    said: list[tuple[str, str]] = []
    for attempt in range(1, attempts + 1):
        answer = ask(said)
        reading = read_answer(answer, objects)
        states |= reading.states
        if not reading.unread or attempt == attempts:
            break
        said += [("assistant", answer), ("user", again(reading, objects))]
    return states


def some_picture(name: str, image: Frame | None) -> Frame:
    """Return the picture that a model is asked about; ModelError where there is none."""
    if image is None:
        raise ModelError(f"{name} reads pictures, and there is none: nothing was rendered")
    return image


def picture_url(image: Frame) -> str:
    """Return a picture, uint8 (H, W, 3), as a data URI (PNG)."""
    from PIL import Image

    data = io.BytesIO()
    Image.fromarray(image).save(data, "PNG")
    return f"data:image/png;base64,{base64.b64encode(data.getvalue()).decode()}"
