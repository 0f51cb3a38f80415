"""A run over lived-in homes is a TOML file: settings, rows, and which homes."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from karma.bench.engine.experiment import check_listed
from karma.loading.models import Models
from karma.plugins.homes.lived.designs import DESIGNS
from karma.plugins.homes.lived.request import MOST_PEOPLE, Words, drawn_people

EXPERT = "expert"  # acts on the truth


class LivedRow(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One row of the table: a memory design, and how it is used."""

    name: str
    design: str  # a key of `karma.plugins.homes.lived.designs.DESIGNS`, or "expert"
    closed_loop: bool = True
    verify: Literal["never", "doubted", "always"] = "doubted"  # before it says where a thing is

    def __post_init__(self) -> None:
        """Refuse a design that there is not."""
        if self.design != EXPERT and self.design not in DESIGNS:
            known = ", ".join((*DESIGNS, EXPERT))
            raise ValueError(f"design: there is no {self.design!r}; there are {known}")


class LivedSetting(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Under which conditions homes are lived in."""

    name: str
    disturbance: Annotated[float, Meta(ge=0.0, le=0.5)] = 0.3  # of things, moved a day
    things: Annotated[int, Meta(ge=1)] | None = None  # movable; None: as rooms have them
    units: Annotated[int, Meta(ge=1)] = 10  # of short-term memory
    rooms: Annotated[tuple[Annotated[int, Meta(ge=1, le=12)], ...], Meta(min_length=1)] = (
        2, 3, 3, 4, 4, 5, 5, 6, 8, 12,
    )  # fmt: skip
    words: Words = "known"  # what things are called
    people: Annotated[int, Meta(ge=0, le=MOST_PEOPLE)] = 0  # 0: drawn for each home, 1 to 4


_USUAL = LivedSetting(name="usual")


@dataclass(frozen=True, slots=True, kw_only=True)
class HomeSpec:
    """One home under one setting."""

    number: int
    setting: LivedSetting

    @property
    def name(self) -> str:
        """What tasks are named after."""
        return f"{self.setting.name}/home_{self.number:03d}"

    @property
    def rooms(self) -> int:
        """How many rooms it has."""
        return self.setting.rooms[self.number % len(self.setting.rooms)]

    def people(self, seed: int) -> int:
        """Return how many people live there."""
        return self.setting.people or drawn_people(seed, self.number, self.rooms)


class LivedExperiment(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Every row in every home, day by day."""

    name: str
    benchmark: Literal["lived"]
    rows: tuple[LivedRow, ...]
    settings: Annotated[tuple[LivedSetting, ...], Meta(min_length=1)] = (
        LivedSetting(name="usual"),
    )
    homes: Annotated[int, Meta(ge=1)] = 100
    first_home: Annotated[int, Meta(ge=0)] = 0  # development and report have different ones
    days: Annotated[int, Meta(ge=1)] = 7
    requests: Annotated[int, Meta(ge=1)] = 9  # a day
    tokens: Annotated[int, Meta(ge=16)] = 400  # of facts in a prompt, words and marks
    only: tuple[str, ...] = ()  # homes such as "usual/home_003"; () = all
    models: Models = Models()
    seeds: tuple[int, ...] = (0,)

    def __post_init__(self) -> None:
        """Refuse what there is nothing to do for, or what would be done twice."""
        settings = [one.name for one in self.settings]
        check_listed([row.name for row in self.rows], self.seeds, self.only, settings)

    @property
    def plans(self) -> bool:
        """Whether a language model is needed: none is; requests are read by rules."""
        return False

    def specs(self) -> Iterator[HomeSpec]:
        """Yield the homes of all settings."""
        for setting in self.settings:
            for number in range(self.first_home, self.first_home + self.homes):
                spec = HomeSpec(number=number, setting=setting)
                if not self.only or spec.name in self.only:
                    yield spec
