"""Score a vision model: its answers about objects in frames, compared with the world's state.

Precision, recall and F1 count state words; accuracy counts objects whose words are all right. A
missing or unusable answer counts as missed, never as a guess.
"""

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from karma.models.picture_questions import STATES, names_of
from karma.plugins.training.moments import Sample, generator, moments, room, samples, thinned
from karma.types.roles import VisionModel
from karma.world.core import scene as scenes
from karma.world.core.scene import Scene
from karma.world.event import WorldEvent

LARGE_SHARE = 0.02  # of the frame's pixels
FRESH_ROOMS = 16
DEALS_PER_ROOM = 3
MAX_OBJECTS_PER_FRAME = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class AskedObject:
    """An object in a frame, its true state words, and the model's answer."""

    object_type: str
    share: float  # of the frame's pixels that show it
    truth: tuple[str, ...]
    answer: tuple[str, ...] | None  # None: unusable

    @property
    def is_right(self) -> bool:
        """Whether the answer has every true word and no other."""
        return self.answer == self.truth


@dataclass(frozen=True, slots=True, kw_only=True)
class AskedFrame:
    """A frame and the objects that the model was asked about."""

    room: str
    seconds: float  # timing: depends on the machine
    objects: tuple[AskedObject, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class WordScore:
    """Figures of a state word."""

    support: int  # objects of which it is true
    precision: float | None
    recall: float | None
    f1: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """All figures of one evaluation; a share of nothing is None."""

    model: str
    seed: int
    frames: int
    objects: int
    unanswered: int
    accuracy: float | None
    large_accuracy: float | None  # of objects that fill at least 2 % of their frame
    macro_f1: float | None  # mean over the states that are true of any object
    words: Mapping[str, WordScore]
    ms_per_object: float | None  # timing: depends on the machine


def held_out_rooms(names: Sequence[str], seed: int) -> list[Scene]:
    """Return the named rooms, or all shipped rooms and 16 generated from the seed.

    Names are of scenes, paths of scene files, or "fresh" for the 16; training uses other seeds.
    FileError if there is no such scene.
    """
    shipped = [] if names else sorted(path.stem for path in scenes.SCENES.glob("*.json"))
    found = [scenes.load(name) for name in (*shipped, *names) if name != "fresh"]
    if not names or "fresh" in names:
        found += [room(10_000 + seed, number) for number in range(FRESH_ROOMS)]
    return found


def examine(
    vision: VisionModel, rooms: Sequence[Scene], *, frames: int, seed: int
) -> Iterator[AskedFrame]:
    """Ask a model about frames of rooms; equal arguments ask the same questions.

    The model gets frames, names and regions, never states; rooms come in turn, `frames` in all.
    """
    for name, event, asked in _questions(rooms, frames, seed):
        height, width = event.frame.shape[:2]
        seen = [sample.seen for sample in asked]
        listed = ", ".join(names_of(seen).values())
        begun = time.perf_counter()
        answers = vision.read_states(event.frame, f"look at {listed}", seen)
        seconds = time.perf_counter() - begun
        objects = []
        for sample in asked:
            words = answers.get(sample.seen.object_id)
            objects.append(
                AskedObject(
                    object_type=sample.seen.object_type,
                    share=sample.pixels / (height * width),
                    truth=sample.states,
                    answer=None if words is None else tuple(sorted(words)) or ("none",),
                )
            )
        yield AskedFrame(room=name, seconds=seconds, objects=tuple(objects))


def score(frames: Sequence[AskedFrame], *, model: str, seed: int) -> Score:
    """Return all figures of some answers."""
    objects = [asked for frame in frames for asked in frame.objects]
    words = {word: _word_score(objects, word) for word in STATES}
    f1s = [word.f1 for word in words.values() if word.support and word.f1 is not None]
    seconds = sum(frame.seconds for frame in frames)
    return Score(
        model=model,
        seed=seed,
        frames=len(frames),
        objects=len(objects),
        unanswered=sum(asked.answer is None for asked in objects),
        accuracy=_mean([asked.is_right for asked in objects]),
        large_accuracy=_mean([asked.is_right for asked in objects if asked.share >= LARGE_SHARE]),
        macro_f1=_mean(f1s),
        words=words,
        ms_per_object=1000 * seconds / len(objects) if objects else None,
    )


def _word_score(objects: Sequence[AskedObject], word: str) -> WordScore:
    true = sum(word in asked.truth for asked in objects)
    claimed = sum(word in (asked.answer or ()) for asked in objects)
    both = sum(word in asked.truth and word in (asked.answer or ()) for asked in objects)
    return WordScore(
        support=true,
        precision=both / claimed if claimed else None,
        recall=both / true if true else None,
        f1=2 * both / (true + claimed) if true + claimed else None,
    )


def _mean(values: Sequence[float]) -> float | None:
    return sum(values) / len(values) if values else None


def _questions(
    rooms: Sequence[Scene], frames: int, seed: int
) -> Iterator[tuple[str, WorldEvent, list[Sample]]]:
    """Yield (room, event, objects) for each frame, the same number for each room."""
    left = frames
    for number, scene in enumerate(rooms):
        count = -(-left // (len(rooms) - number))
        left -= count
        rng = generator(seed, "examination", scene.name, str(number))
        views = -(-count // DEALS_PER_ROOM)
        shown = 0
        for event in moments(scene, rng, states=DEALS_PER_ROOM, views=views + 2):
            asked = thinned(samples(event), rng)
            if not asked or shown == count:
                continue
            shown += 1
            order = rng.permutation(len(asked))[:MAX_OBJECTS_PER_FRAME]
            yield scene.name, event, [asked[i] for i in sorted(order.tolist())]
