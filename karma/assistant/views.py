"""Memory as one looks at it: a table of what was handled last, a map of the room.

Both show what the agent remembers, which may be out of date, and never how the room is.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from html import escape

from karma.household.places import FLOOR
from karma.household.saying import told_place
from karma.household.uses import KNOB
from karma.memory.scene_graph import SceneGraph
from karma.types.memory import Area, MemoryUnit

_HEADS = ("object", "states", "where", "handled")
_CM, _MARGIN_CM = 100.0, 30.0
_AREA, _THING = "#3465a4", "#888a85"  # colours that show on light and dark


@dataclass(frozen=True, slots=True, repr=False)
class Memory:
    """Short-term memory at one moment, the last used last."""

    units: tuple[MemoryUnit, ...]
    capacity: int

    def __len__(self) -> int:
        return len(self.units)

    def __iter__(self) -> Iterator[MemoryUnit]:
        return iter(self.units)

    def lines(self) -> list[str]:
        """Return a line for each thing."""
        head = f"short-term memory: {len(self)} of {self.capacity} lines"
        return [head, *(f"  {_sentence(unit)}" for unit in self.units)]

    def __repr__(self) -> str:
        return "\n".join(self.lines())

    def _repr_html_(self) -> str:
        """Return a table; all text is escaped."""
        rows = "".join(
            f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in _cells(unit))}</tr>"
            for unit in self.units
        )
        heads = "".join(f"<th>{head}</th>" for head in _HEADS)
        return f"<table><thead><tr>{heads}</tr></thead><tbody>{rows}</tbody></table>"


def _cells(unit: MemoryUnit) -> tuple[str, str, str, str]:
    states = ", ".join(unit.states) or "–"
    return unit.object_type, states, told_place(unit.place_id), "yes" if unit.handled else "no"


def _sentence(unit: MemoryUnit) -> str:
    kind, states, where, _ = _cells(unit)
    return f"{kind} {where}" + (f": {states}" if unit.states else "")


@dataclass(frozen=True, slots=True, repr=False)
class RoomMap:
    """Long-term memory of a room: places to stand, and the furniture near each."""

    scene: str
    areas: tuple[Area, ...]

    @classmethod
    def of(cls, scene: str, graph: SceneGraph | None) -> "RoomMap":
        """Return the map as it is remembered; an empty one without long-term memory."""
        return cls(scene, graph.areas() if graph else ())

    def types(self) -> tuple[str, ...]:
        """Return the types of furniture on it."""
        kinds = (kind for area in self.areas for kind in area.contains)
        return tuple(sorted({*kinds} - {FLOOR, KNOB}))

    def lines(self) -> list[str]:
        """Return a line for each place to stand."""
        count = sum(len(area.fixtures) for area in self.areas)
        head = f"{self.scene}: {len(self.areas)} places to stand, {count} fixed things"
        return [head, *(f"  {_place(area)}" for area in self.areas)]

    def __repr__(self) -> str:
        return "\n".join(self.lines())

    def _repr_html_(self) -> str:
        """Return the map as SVG, seen from above; all text is escaped."""
        if not self.areas:
            return f"<p>{escape(repr(self))}</p>"
        points = [area.position_m for area in self.areas]
        points += [one.position_m for area in self.areas for one in area.fixtures]
        left, right = (f(_CM * x for x, _, _ in points) for f in (min, max))
        top, bottom = (f(-_CM * z for _, _, z in points) for f in (min, max))
        width, height = right - left + 2 * _MARGIN_CM, bottom - top + 2 * _MARGIN_CM
        box = f"{left - _MARGIN_CM:.0f} {top - _MARGIN_CM:.0f} {width:.0f} {height:.0f}"
        body = "".join([*self._edges(), *self._things(), *self._marks()])
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{box}" width="{width:.0f}" '
            f'font-family="sans-serif" font-size="11" role="img">'
            f"<title>{escape(self.lines()[0])}</title>{body}</svg>"
        )

    def _edges(self) -> Iterator[str]:
        at = {area.name: area.position_m for area in self.areas}
        for area in self.areas:
            for other in area.adjacent:
                if area.name < other and other in at:
                    (x1, _, z1), (x2, _, z2) = at[area.name], at[other]
                    yield (
                        f'<line x1="{_CM * x1:.0f}" y1="{-_CM * z1:.0f}" x2="{_CM * x2:.0f}" '
                        f'y2="{-_CM * z2:.0f}" stroke="{_AREA}" stroke-opacity="0.4"/>'
                    )

    def _things(self) -> Iterator[str]:
        for area in self.areas:
            for one in area.fixtures:
                if one.object_type not in (FLOOR, KNOB):
                    x, z = _CM * one.position_m[0], -_CM * one.position_m[2]
                    yield (
                        f'<rect x="{x - 3:.0f}" y="{z - 3:.0f}" width="6" height="6" '
                        f'fill="{_THING}"/><text x="{x + 5:.0f}" y="{z + 4:.0f}" '
                        f'fill="{_THING}">{escape(one.object_type)}</text>'
                    )

    def _marks(self) -> Iterator[str]:
        for area in self.areas:
            x, z = _CM * area.position_m[0], -_CM * area.position_m[2]
            yield (
                f'<circle cx="{x:.0f}" cy="{z:.0f}" r="5" fill="{_AREA}">'
                f"<title>{escape(_place(area))}</title></circle>"
            )


def _place(area: Area) -> str:
    things = [kind for kind in area.contains if kind not in (FLOOR, KNOB)]
    return f"{area.name}: {', '.join(things) or 'nothing'}"
