"""Draw a room from above, for people."""

from math import cos, radians, sin
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrow, Rectangle

from karma.errors import FileError
from karma.household import places
from karma.household.types import object_type
from karma.world.core.boxes import Box
from karma.world.core.scene import Scene, SceneObject

FLOOR, WALL, CELL, AGENT = "#f6f1e7", "#4a4a4a", "#b5cbb5", "#d62728"
FURNITURE, BLUE, FIXTURE = "#dccaa9", "#5b7ba3", "#77705f"
ON, IN = "#1f5fa8", "#8e44ad"  # things that lie open, and in something closed
HIGH_M = 1.2  # furniture that begins higher is drawn as an outline
SMALL_M2 = 0.03  # fixtures with less ground are drawn as squares
STACK_M = 0.30  # same types closer than this share a label
WIDTH_IN, DPI = 9.0, 120


def draw_top_down(scene: Scene, path: str | Path) -> None:
    """Write a PNG of the scene: cells, furniture, things and the agent's start.

    Raises:
        FileError: the file cannot be written.
    """
    x, _, z = scene.bounds_size
    figure = Figure(figsize=(WIDTH_IN, WIDTH_IN * max(z, 1.0) / max(x, 1.0) + 0.6), dpi=DPI)
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    _draw_room(axes, scene)
    labels = _Labels(axes, metres_per_point=(x + 0.3) / (WIDTH_IN * 0.775 * 72))
    _draw_furniture(axes, scene, labels)
    _draw_fixtures(axes, scene, labels)
    by_id = {thing.id: thing for thing in scene.objects}
    for thing in scene.objects:
        if "pickupable" in thing.capabilities:
            _draw_thing(axes, thing, by_id, labels)
    _draw_agent(axes, scene)
    _finish(axes, scene)
    try:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, format="png", bbox_inches="tight", metadata={"Software": None})
    except OSError as error:
        reason = f"cannot write: {error.strerror or error}"
        raise FileError(path, reason, fix="choose another file with --out") from error


class _Labels:
    """Puts each label at the first of some spots around its point where none is yet."""

    SPOTS = ((0, 0), (0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, 1), (1, -1), (-1, -1),
             (0, 2), (0, -2), (1, 2), (-1, 2), (1, -2), (-1, -2), (0, 3), (0, -3))  # fmt: skip

    def __init__(self, axes: Axes, metres_per_point: float) -> None:
        self.axes, self.scale, self.taken = axes, metres_per_point, list[Box]()

    def put(self, text: str, x: float, z: float, *, size: float, color: str, lift: float) -> None:
        """Write `text` near (x, z), `lift` metres off the point in the chosen direction."""
        width, height = len(text) * size * 0.56 * self.scale, size * 1.25 * self.scale
        spots = self.SPOTS if not lift else self.SPOTS[1:]
        boxes = []
        for right, up in spots:
            at_x = x + right * (width / 2 + lift)
            at_z = z + up * (height * (0.8 if abs(right) else 1.0) + lift * (up != 0) * 0.3)
            low_x, low_z = at_x - width / 2, at_z - height / 2
            boxes.append(Box(low_x, 0, low_z, low_x + width, 1, low_z + height))
        clashes = [sum(box.overlaps(other) for other in self.taken) for box in boxes]
        best = boxes[clashes.index(min(clashes))]
        self.taken.append(best)
        at_x, _, at_z = best.center
        if abs(at_z - z) > 1.9 * height:
            self.axes.plot([x, at_x], [z, at_z], lw=0.4, color=color, zorder=3)
        self.axes.text(
            at_x, at_z, text, fontsize=size, color=color, ha="center", va="center", zorder=6
        )


def _draw_room(axes: Axes, scene: Scene) -> None:
    (x, _, z), (width, _, depth) = scene.bounds_center, scene.bounds_size
    corner = (x - width / 2, z - depth / 2)
    axes.add_patch(Rectangle(corner, width, depth, fc=FLOOR, ec=WALL, lw=3, zorder=0))
    if scene.reachable:
        xs, zs = zip(*scene.reachable, strict=True)
        axes.scatter(xs, zs, s=10, c=CELL, zorder=1, label="cells to stand on")


def _is_small(thing: SceneObject) -> bool:
    return thing.size[0] * thing.size[2] < SMALL_M2


def _fixed(scene: Scene) -> list[SceneObject]:
    """Return what is not to be carried, the lowest first."""
    fixed = (
        o for o in scene.objects if o.type != places.FLOOR and "pickupable" not in o.capabilities
    )
    return sorted(fixed, key=lambda one: (one.center[1] + one.size[1] / 2, one.id))


def _draw_furniture(axes: Axes, scene: Scene, labels: _Labels) -> None:
    big = [one for one in _fixed(scene) if not _is_small(one)]
    for thing in big:
        x, y, z = thing.center
        width, height, depth = thing.size
        high = y - height / 2 - scene.floor_y > HIGH_M
        style = {"fill": False, "ls": ":", "ec": BLUE} if high else {"fc": FURNITURE, "ec": WALL}
        corner = (x - width / 2, z - depth / 2)
        axes.add_patch(Rectangle(corner, width, depth, lw=0.8, alpha=0.8, zorder=2, **style))
    covered = {one.id for one in big if any(_covers(other, one) for other in big)}
    for group in sorted(_stacks(big), key=lambda group: group[0].id in covered):
        x, y, z = group[0].center
        high = y - group[0].size[1] / 2 - scene.floor_y > HIGH_M
        part = group[0].id in covered
        color = BLUE if high else FIXTURE if part else "black"
        labels.put(_text(group), x, z, size=5.5 if part or high else 7.5, color=color, lift=0.0)


def _draw_fixtures(axes: Axes, scene: Scene, labels: _Labels) -> None:
    small = [one for one in _fixed(scene) if _is_small(one)]
    for thing in small:
        axes.plot(thing.center[0], thing.center[2], "s", ms=3.0, color=FIXTURE, zorder=4)
    for group in _stacks(small):
        x = sum(one.center[0] for one in group) / len(group)
        z = sum(one.center[2] for one in group) / len(group)
        labels.put(_text(group), x, z, size=5.5, color=FIXTURE, lift=0.06)


def _covers(other: SceneObject, one: SceneObject) -> bool:
    """Return whether `one` has its middle within the clearly larger ground of `other`."""
    ground, own = other.size[0] * other.size[2], one.size[0] * one.size[2]
    near = all(abs(other.center[i] - one.center[i]) < other.size[i] / 2 for i in (0, 2))
    return near and ground > own * 1.15


def _stacks(things: list[SceneObject]) -> list[list[SceneObject]]:
    """Return the objects in groups of one type that lie above or close to one another."""
    groups: list[list[SceneObject]] = []
    for thing in things:
        for group in groups:
            first = group[0]
            apart = max(abs(first.center[i] - thing.center[i]) for i in (0, 2))
            if first.type == thing.type and apart < STACK_M:
                group.append(thing)
                break
        else:
            groups.append([thing])
    return groups


def _text(group: list[SceneObject]) -> str:
    return group[0].type if len(group) == 1 else f"{group[0].type} x{len(group)}"


def _draw_thing(
    axes: Axes, thing: SceneObject, by_id: dict[str, SceneObject], labels: _Labels
) -> None:
    x, _, z = thing.center
    hidden = any(
        object_type(by_id[parent].type).must_be_open and by_id[parent].openness == 0.0
        for parent in thing.parents
    )
    color = IN if hidden else ON
    axes.plot(x, z, "o", ms=4.5, color=color, mfc="white" if hidden else color, zorder=5)
    labels.put(thing.type, x, z, size=6, color=color, lift=0.06)


def _draw_agent(axes: Axes, scene: Scene) -> None:
    x, _, z = scene.agent.position
    yaw = radians(scene.agent.yaw)
    axes.add_patch(
        FancyArrow(x, z, 0.3 * sin(yaw), 0.3 * cos(yaw), width=0.05, head_width=0.18,
                   length_includes_head=True, color=AGENT, zorder=7)
    )  # fmt: skip


def _finish(axes: Axes, scene: Scene) -> None:
    (x, _, z), (width, _, depth) = scene.bounds_center, scene.bounds_size
    axes.set_xlim(x - width / 2 - 0.15, x + width / 2 + 0.15)
    axes.set_ylim(z - depth / 2 - 0.15, z + depth / 2 + 0.15)
    axes.set_aspect("equal")
    axes.set_xlabel("x (m)")
    axes.set_ylabel("z (m)")
    axes.set_title(
        f"{scene.name}: {scene.room}, {len(scene.objects)} objects, {len(scene.reachable)} cells\n"
        "filled dot: lies open; ring: in something closed; dotted: hangs high; arrow: start",
        fontsize=10,
    )
