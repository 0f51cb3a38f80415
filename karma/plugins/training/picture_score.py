"""How good a vision model is: its answers on frames of rooms held against the truth; and a page.

Words are counted one by one, an object's answer is right when all its words are. What a model left
unanswered, or answered unusably, counts as missed and never as a guess.
"""

import base64
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from karma.agent.seeing.picture_states import png
from karma.contracts import Frame, SeenObject, VisionModel
from karma.household.states import OPPOSITES
from karma.models.picture_questions import STATES, cut, names_of
from karma.plugins.training.moments import Sample, generator, moments, room, samples, thinned
from karma.world.core import scene as scenes
from karma.world.core.scene import Scene
from karma.world.event import WorldEvent

LARGE = 0.02  # share of the frame
FRESH = 16  # rooms of nobody's acquaintance, drawn from the seed
DEALS = 3  # times that states are dealt out in a room
MOST = 8  # objects asked about in one frame
NOTHING = "–"  # stands for a missing word, in the matrix


@dataclass(frozen=True, slots=True, kw_only=True)
class AskedCrop:
    """One object in one frame: what it is, and what the model said."""

    room: str
    frame: int
    object_type: str
    share: float  # of the frame's pixels that show it
    truth: tuple[str, ...]
    said: tuple[str, ...] | None  # None: no usable answer
    picture: Frame | None = field(default=None, compare=False, repr=False)  # of a failure

    @property
    def right(self) -> bool:
        """Whether all words are right and none is missing."""
        return self.said == self.truth


@dataclass(frozen=True, slots=True, kw_only=True)
class WordScore:
    """One state's line."""

    support: int  # objects of which it is true
    precision: float | None
    recall: float | None
    f1: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Accuracy:
    """So many of so many."""

    right: int
    of: int

    @property
    def value(self) -> float | None:
        """The share in [0, 1]; None of nothing."""
        return self.right / self.of if self.of else None


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """All figures of one evaluation."""

    model: str
    seed: int
    frames: int
    objects: int
    unanswered: int
    accuracy: float | None  # objects right in every word
    large: Accuracy  # the same, of objects that fill at least 2 % of their frame
    macro_f1: float | None  # mean over the states that are true of anything
    words: Mapping[str, WordScore]
    matrix: Mapping[str, Mapping[str, int]]  # true word -> said word -> count
    types: Mapping[str, Accuracy]
    ms_per_frame: float | None  # timing: depends on the machine
    ms_per_object: float | None


def held_out_rooms(names: Sequence[str], seed: int) -> list[Scene]:
    """Return the rooms to examine in: those named, else all that ship and 16 drawn from the seed.

    Names are of scenes, paths of scene files, or "fresh" for the 16; training uses other seeds.
    FileError if there is no such scene.
    """
    shipped = [] if names else sorted(path.stem for path in scenes.SCENES.glob("*.json"))
    found = [scenes.load(name) for name in (*shipped, *names) if name != "fresh"]
    if not names or "fresh" in names:
        found += [room(10_000 + seed, number) for number in range(FRESH)]
    return found


def examine(
    vision: VisionModel, rooms: Sequence[Scene], *, frames: int, seed: int, clock: "Clock"
) -> Iterator[AskedCrop]:
    """Ask a model about frames of rooms; equal arguments ask the same questions.

    The model gets frames, names and regions, never states; rooms come in turn, `frames` in all.
    """
    for number, (name, event, asked) in enumerate(_questions(rooms, frames, seed)):
        frame = event.frame
        sights = [one.seen for one in asked]
        listed = ", ".join(names_of(sights).values())
        begun = time.perf_counter()
        answers = vision.read_states(frame, f"look at {listed}", sights)
        clock.add(time.perf_counter() - begun, len(sights))
        for one in asked:
            words = answers.get(one.seen.object_id)
            said = None if words is None else tuple(sorted(words)) or ("none",)
            yield AskedCrop(
                room=name,
                frame=number,
                object_type=one.seen.object_type,
                share=one.pixels / (frame.shape[0] * frame.shape[1]),
                truth=one.states,
                said=said,
                picture=None if said == one.states else _shown(frame, one.seen),
            )


class Clock:
    """Adds up the time that answers took."""

    def __init__(self) -> None:
        self.seconds, self.frames, self.objects = 0.0, 0, 0

    def add(self, seconds: float, objects: int) -> None:
        """Count one frame."""
        self.seconds += seconds
        self.frames += 1
        self.objects += objects

    def ms(self, count: int) -> float | None:
        """Return milliseconds for each of so many; None of none."""
        return self.seconds * 1000 / count if count else None


def score(asked: Sequence[AskedCrop], *, model: str, seed: int, clock: Clock) -> Score:
    """Return all figures of some answers."""
    words = {word: _word(asked, word) for word in STATES}
    known = [one.f1 for one in words.values() if one.support and one.f1 is not None]
    large = [one for one in asked if one.share >= LARGE]
    kinds = sorted({one.object_type for one in asked})
    return Score(
        model=model,
        seed=seed,
        frames=clock.frames,
        objects=len(asked),
        unanswered=sum(one.said is None for one in asked),
        accuracy=_share(asked).value,
        large=_share(large),
        macro_f1=sum(known) / len(known) if known else None,
        words=words,
        matrix=confusion(asked),
        types={kind: _share(one for one in asked if one.object_type == kind) for kind in kinds},
        ms_per_frame=clock.ms(clock.frames),
        ms_per_object=clock.ms(clock.objects),
    )


def confusion(asked: Iterable[AskedCrop]) -> dict[str, dict[str, int]]:
    """Return true word -> said word -> count.

    Words that are true and said stand on the diagonal. Of the others a true one is paired with its
    opposite if that was said, else with the next wrong one; "–" is said in place of a word that
    has no partner, and is the truth behind a word too many.
    """
    counts: Counter[tuple[str, str]] = Counter()
    for one in asked:
        said = set(one.said or ())
        missing = [word for word in one.truth if word not in said]
        wrong = sorted(said - set(one.truth))
        counts.update((word, word) for word in one.truth if word in said)
        missing.sort(key=lambda word: OPPOSITES.get(word) not in wrong)
        for word in missing:
            partner = OPPOSITES.get(word)
            if partner not in wrong:
                partner = wrong[0] if wrong else NOTHING
            counts[word, partner] += 1
            if partner in wrong:
                wrong.remove(partner)
        counts.update((NOTHING, word) for word in wrong)
    rows = (*STATES, NOTHING)
    return {row: {column: counts[row, column] for column in rows} for row in rows}


def _word(asked: Sequence[AskedCrop], word: str) -> WordScore:
    true = sum(word in one.truth for one in asked)
    claimed = sum(word in (one.said or ()) for one in asked)
    both = sum(word in one.truth and word in (one.said or ()) for one in asked)
    return WordScore(
        support=true,
        precision=both / claimed if claimed else None,
        recall=both / true if true else None,
        f1=2 * both / (true + claimed) if true + claimed else None,
    )


def _share(asked: Iterable[AskedCrop]) -> Accuracy:
    outcomes = [one.right for one in asked]
    return Accuracy(right=sum(outcomes), of=len(outcomes))


def _questions(
    rooms: Sequence[Scene], frames: int, seed: int
) -> Iterator[tuple[str, WorldEvent, list[Sample]]]:
    """Yield (room, event, objects) for each frame, the same number for each room."""
    left = frames
    for number, one in enumerate(rooms):
        count = -(-left // (len(rooms) - number))
        left -= count
        rng = generator(seed, "examination", one.name, str(number))
        views = -(-count // DEALS)
        shown = 0
        for event in moments(one, rng, states=DEALS, views=views + 2):
            asked = thinned(samples(event), rng)
            if not asked or shown == count:
                continue
            shown += 1
            order = rng.permutation(len(asked))[:MOST]
            yield one.name, event, [asked[i] for i in sorted(order.tolist())]


def _shown(frame: Frame, one: SeenObject) -> Frame | None:
    return None if one.region is None else cut(frame, one.region, 1.5, one.silhouette)


TEMPLATE = Path(__file__).parent / "picture_score.html.j2"
MOST_FAILURES = 120


def page(score: Score, asked: Sequence[AskedCrop]) -> str:
    """Return the page."""
    from jinja2 import Environment, StrictUndefined

    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, keep_trailing_newline=True
    )
    wrong = sorted((one for one in asked if not one.right), key=lambda one: -one.share)
    types = sorted(score.types.items(), key=lambda item: (item[1].value or 0.0, item[0]))
    return environment.from_string(TEMPLATE.read_text(encoding="utf-8")).render(
        score=score,
        rooms=list(dict.fromkeys(one.room for one in asked)),
        types=types,
        wrong=len(wrong),
        failures=[_card(one) for one in wrong[:MOST_FAILURES]],
        figure=lambda value: "–" if value is None else f"{value:.3f}",
        ms=lambda value: "–" if value is None else f"{value:.0f}",
    )


def _card(one: AskedCrop) -> dict[str, object]:
    picture = "" if one.picture is None else base64.b64encode(png(one.picture)).decode()
    return {
        "object_type": one.object_type,
        "room": one.room,
        "frame": one.frame,
        "share": one.share,
        "truth": ", ".join(one.truth),
        "said": "no usable answer" if one.said is None else ", ".join(one.said),
        "picture": f"data:image/png;base64,{picture}",
    }
