"""Words for things: a remembered unit by its name, its kind, its states, its place, or "it"."""

from collections.abc import Sequence
from dataclasses import dataclass

from karma.contracts import MemoryUnit
from karma.prompt import Facts, base_type
from karma.training.phrases import Book, lexicon
from karma.training.recollections import Rng, Room, pick, place_type


@dataclass(frozen=True, slots=True, kw_only=True)
class Situation:
    """One draw: what is known, and what a request may name."""

    room: Room
    facts: Facts  # without the instruction
    names: dict[str, str]  # object id -> short name
    book: Book
    excluded: frozenset[tuple[str, str]]
    mapped: bool  # long-term memory is there

    @property
    def units(self) -> Sequence[MemoryUnit]:
        """Short-term memory, the last used last."""
        return self.facts.units


@dataclass(frozen=True, slots=True, kw_only=True)
class Ref:
    """An object that a request names: its program name, type, and the words for it."""

    name: str
    object_type: str
    words: str  # with article, or a pronoun
    bare: str  # without
    plain: bool = True  # the bare name alone means this object


def refer(rng: Rng, scene: Situation, unit: MemoryUnit) -> Ref | None:
    """Draw words that mean this unit and no other; None after a few tries."""
    name = scene.names[unit.object_id]
    entry = lexicon()[base_type(unit.object_type)]
    for _ in range(4):
        roll = rng.random()
        bare = pick(rng, entry.names)
        if roll < 0.55:
            said = _adjective(rng, scene, unit, 0.3)
            words, meant = f"{said[0]} {bare}".strip(), _meant(scene, unit, said[1], exact=True)
            text = with_article(rng, words)
        elif roll < 0.80 and entry.kinds:
            kind = pick(rng, entry.kinds)
            said = _adjective(rng, scene, unit, 0.6)
            meant = _meant(scene, unit, said[1], kind=kind)
            text = f"the {said[0]} {kind}".replace("  ", " ")
        elif roll < 0.88:
            text, meant = pick(rng, ("it", "it", "that", "this")), _last_handled(scene)
        elif roll < 0.94:
            text, meant = _just(rng, scene, unit)
        else:
            text, meant = _placed_words(rng, scene, unit)
        if "sliced" in unit.states and rng.random() < 0.3:
            text = f"{pick(rng, ('a slice of', 'a piece of', 'some of', 'one slice of'))} {text}"
        if meant is not None and meant.object_id == unit.object_id:
            plain = _meant(scene, unit, "", exact=True) is unit
            return Ref(name=name, object_type=unit.object_type, words=text, bare=bare, plain=plain)
    return None


def _adjective(rng: Rng, scene: Situation, unit: MemoryUnit, chance: float) -> tuple[str, str]:
    """Return (word, state) for one of the unit's states, or two empty strings."""
    states = [s for s in unit.states if scene.book.adjectives.get(s.replace(" ", "_"))]
    if not states or rng.random() > chance:
        return "", ""
    state = pick(rng, states)
    return pick(rng, scene.book.adjectives[state.replace(" ", "_")]), state


def _meant(
    scene: Situation, unit: MemoryUnit, state: str, *, exact: bool = False, kind: str = ""
) -> MemoryUnit | None:
    """Return which unit such words mean: the last handled one that fits, else the last one."""

    def fits(other: MemoryUnit) -> bool:
        base = base_type(other.object_type)
        named = base == base_type(unit.object_type) if exact else kind in lexicon()[base].kinds
        return named and (not state or state in other.states)

    fitting = [other for other in scene.units if fits(other)]
    handled = [other for other in fitting if other.handled]
    chosen = handled or fitting
    return chosen[-1] if chosen else None


def _last_handled(scene: Situation) -> MemoryUnit | None:
    return next((unit for unit in reversed(scene.units) if unit.handled), None)


def _just(rng: Rng, scene: Situation, unit: MemoryUnit) -> tuple[str, MemoryUnit | None]:
    """Return words such as `the thing you just washed`, and the unit they mean."""
    options = [s for s in unit.states if s in scene.book.just]
    state = pick(rng, (*options, "moved"))
    noun = pick(rng, ("thing", "one", "item", "object"))
    words = f"the {noun} {pick(rng, scene.book.just[state])}"
    if state == "moved":
        return words, _last_handled(scene)
    fitting = [u for u in scene.units if state in u.states]
    handled = [u for u in fitting if u.handled]
    return words, (handled or fitting)[-1]


def _placed_words(rng: Rng, scene: Situation, unit: MemoryUnit) -> tuple[str, MemoryUnit | None]:
    """Return words that name a unit by where it is or by what is in it, and what they mean."""
    cargo = [other for other in scene.units if other.place_id == unit.object_id]
    if cargo:
        inside = pick(rng, lexicon()[base_type(cargo[-1].object_type)].names)
        noun = pick(rng, (*lexicon()[base_type(unit.object_type)].names, "container", "dish"))
        return f"the {noun} with the {inside}", unit
    if unit.place_id is None or unit.place_id == "hand":
        return "", None
    place = place_type(scene.units, unit.place_id)
    if base_type(place) not in lexicon():
        return "", None
    there = [u for u in scene.units if u.place_id and place_type(scene.units, u.place_id) == place]
    handled = [other for other in there if other.handled] or there
    entry = lexicon()[base_type(unit.object_type)]
    noun = pick(rng, ("thing", "object", "item", *entry.names, *entry.kinds))
    if noun in (*entry.names, *entry.kinds):
        fitting = [
            u
            for u in there
            if noun in lexicon()[base_type(u.object_type)].names
            or noun in lexicon()[base_type(u.object_type)].kinds
        ]
        handled = [other for other in fitting if other.handled] or fitting
    where = pick(rng, lexicon()[base_type(place)].names)
    words = pick(
        rng,
        (
            "the {n} in the {w}",
            "the {n} on the {w}",
            "the {n} from the {w}",
            "what you put in the {w}",
            "what is on the {w}",
            "what you left on the {w}",
        ),
    )
    if "{n}" not in words:
        handled = [other for other in there if other.handled] or there
    return words.format(n=noun, w=where), handled[-1]


def with_article(rng: Rng, words: str, article: str = "") -> str:
    """Put an article before a name, a drawn one unless it is given."""
    if not article:
        article = pick(rng, ("the", "the", "the", "the", "a", "a", "my", "that", "one of the", ""))
    if article == "one of the":
        words += "s"
    if article == "a" and words[0] in "aeiou":
        article = "an"
    return f"{article} {words}".strip()
