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
FURNITURE, HANGING, FIXTURE = "#dccaa9", "#5b7ba3", "#77705f"
OPEN, SHUT_IN = "#1f5fa8", "#8e44ad"  # things that lie open, and in something closed
HIGH_M = 1.2  # furniture that begins higher is drawn as an outline
SMALL_M2 = 0.03  # fixtures with less ground are drawn as squares
WIDTH_IN, DPI = 9.0, 120
_SPOTS = ((0, 0), (0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, 1), (1, -1), (-1, -1),
          (0, 2), (0, -2), (1, 2), (-1, 2), (1, -2), (-1, -2), (0, 3), (0, -3))  # fmt: skip


def draw_top_down(scene: Scene, path: str | Path) -> None:
    """Write a PNG of the scene: cells, furniture, things and the agent's start.

    Raises:
        FileError: the file cannot be written.
    """
    (x, _, z), (width, _, depth) = scene.bounds_center, scene.bounds_size
    figure = Figure(figsize=(WIDTH_IN, WIDTH_IN * max(depth, 1.0) / max(width, 1.0) + 0.6), dpi=DPI)
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    corner = (x - width / 2, z - depth / 2)
    axes.add_patch(Rectangle(corner, width, depth, fc=FLOOR, ec=WALL, lw=3, zorder=0))
    if scene.reachable:
        xs, zs = zip(*scene.reachable, strict=True)
        axes.scatter(xs, zs, s=10, c=CELL, zorder=1)
    _draw_objects(axes, scene, metres_per_point=(width + 0.3) / (WIDTH_IN * 0.775 * 72))
    x, _, z = scene.agent.position
    dx, dz = 0.3 * sin(radians(scene.agent.yaw)), 0.3 * cos(radians(scene.agent.yaw))
    axes.add_patch(
        FancyArrow(x, z, dx, dz, width=0.05, head_width=0.18, length_includes_head=True,
                   color=AGENT, zorder=7)
    )  # fmt: skip
    axes.set_xlim(corner[0] - 0.15, corner[0] + width + 0.15)
    axes.set_ylim(corner[1] - 0.15, corner[1] + depth + 0.15)
    axes.set_aspect("equal")
    axes.set_xlabel("x (m)")
    axes.set_ylabel("z (m)")
    axes.set_title(
        f"{scene.name}: {scene.room}, {len(scene.objects)} objects, {len(scene.reachable)} cells\n"
        "filled dot: lies open; ring: in something closed; dotted: hangs high; arrow: start",
        fontsize=10,
    )
    try:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, format="png", bbox_inches="tight", metadata={"Software": None})
    except OSError as error:
        reason = f"cannot write: {error.strerror or error}"
        raise FileError(path, reason, fix="choose another file with --out") from error


def _draw_objects(axes: Axes, scene: Scene, metres_per_point: float) -> None:
    """Draw furniture as boxes, fixtures as squares and things as dots, with their types."""
    labels = _Labels(axes, metres_per_point)
    by_id = {thing.id: thing for thing in scene.objects}
    fixed = [
        o for o in scene.objects if o.type != places.FLOOR and "pickupable" not in o.capabilities
    ]
    for thing in sorted(fixed, key=lambda one: (one.center[1] + one.size[1] / 2, one.id)):
        (x, y, z), (width, height, depth) = thing.center, thing.size
        if width * depth < SMALL_M2:
            axes.plot(x, z, "s", ms=3.0, color=FIXTURE, zorder=4)
            labels.put(thing.type, x, z, size=5.5, color=FIXTURE, lift=0.06)
            continue
        high = y - height / 2 - scene.floor_y > HIGH_M
        style = {"fill": False, "ls": ":", "ec": HANGING} if high else {"fc": FURNITURE, "ec": WALL}
        corner = (x - width / 2, z - depth / 2)
        axes.add_patch(Rectangle(corner, width, depth, lw=0.8, alpha=0.8, zorder=2, **style))
        color, size = (HANGING, 5.5) if high else ("black", 7.5)
        labels.put(thing.type, x, z, size=size, color=color, lift=0.0)
    for thing in scene.objects:
        if "pickupable" in thing.capabilities:
            x, _, z = thing.center
            color, fill = (SHUT_IN, "white") if _is_shut_in(thing, by_id) else (OPEN, OPEN)
            axes.plot(x, z, "o", ms=4.5, color=color, mfc=fill, zorder=5)
            labels.put(thing.type, x, z, size=6, color=color, lift=0.06)


def _is_shut_in(thing: SceneObject, by_id: dict[str, SceneObject]) -> bool:
    return any(
        object_type(by_id[parent].type).must_be_open and by_id[parent].openness == 0.0
        for parent in thing.parents
    )


class _Labels:
    """Put each label at the spot around its point that covers the fewest others."""

    def __init__(self, axes: Axes, metres_per_point: float) -> None:
        self.axes, self.scale, self.taken = axes, metres_per_point, list[Box]()

    def put(self, text: str, x: float, z: float, *, size: float, color: str, lift: float) -> None:
        """Write `text` near (x, z), `lift` metres off the point in the chosen direction."""
        width, height = len(text) * size * 0.56 * self.scale, size * 1.25 * self.scale
        boxes = []
        for right, up in _SPOTS if not lift else _SPOTS[1:]:
            at_x = x + right * (width / 2 + lift)
            at_z = z + up * (height * (0.8 if abs(right) else 1.0) + lift * (up != 0) * 0.3)
            low_x, low_z = at_x - width / 2, at_z - height / 2
            boxes.append(Box(low_x, 0, low_z, low_x + width, 1, low_z + height))
        best = min(boxes, key=lambda box: sum(box.overlaps(other) for other in self.taken))
        self.taken.append(best)
        at_x, _, at_z = best.center
        if abs(at_z - z) > 1.9 * height:
            self.axes.plot([x, at_x], [z, at_z], lw=0.4, color=color, zorder=3)
        self.axes.text(
            at_x, at_z, text, fontsize=size, color=color, ha="center", va="center", zorder=6
        )
