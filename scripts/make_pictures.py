"""Write docs/pictures: our rooms, what a camera gives, every type, and every visible state."""

import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from karma.contracts import Vec3
from karma.household.types import object_types
from karma.offline import go_offline
from karma.world.core.camera import Camera
from karma.world.core.scene import AgentPose, Scene, SceneObject, load
from karma.world.core.state import Settings, WorldState, begin
from karma.world.render.colours import class_frame, instance_frame
from karma.world.render.picture import agent_camera, render

FOLDER = Path(__file__).parents[1] / "docs" / "pictures"
ROOMS = ("kitchen_1", "living_1", "bedroom_1", "bathroom_1")
LABEL_PX = 14
STEP = 10  # of a colour's parts
STATES: dict[str, tuple[str, dict[str, Any]]] = {
    "openable": ("open", {"openness": 1.0}),
    "toggleable": ("on", {"is_toggled": True}),
    "breakable": ("broken", {"is_broken": True}),
    "canFillWithLiquid": ("water", {"is_filled": True, "liquid": "water"}),
    "dirtyable": ("dirty", {"is_dirty": True}),
    "canBeUsedUp": ("used up", {"is_used_up": True}),
    "cookable": ("cooked", {"is_cooked": True}),
}
EXTRA: tuple[tuple[str, str, dict[str, Any]], ...] = (
    ("StoveBurner", "on", {"is_toggled": True}),
    ("Mug", "coffee", {"is_filled": True, "liquid": "coffee"}),
    ("Cup", "wine", {"is_filled": True, "liquid": "wine"}),
    ("Mug", "hot", {"temperature": "Hot"}),
    ("Potato", "hot", {"temperature": "Hot"}),
    ("Pan", "cold", {"temperature": "Cold"}),
    ("Apple", "cold", {"temperature": "Cold"}),
)
Cell = tuple[str, np.ndarray]


def main() -> None:
    """Write all pictures, in steps of colour that keep the files small."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    _save("rooms", _grid(list(_rooms()), 260, 4))
    _save("panels", _grid(list(_panels()), 300, 5))
    kinds = [kind for kind in object_types() if kind != "Floor"]
    _save("types", _grid([(kind, _shot(kind, 104)) for kind in kinds], 104, 14))
    _save("states", _grid(list(_states()), 104, 14))


def _save(name: str, picture: Image.Image) -> None:
    path = FOLDER / f"{name}.png"
    coarse = (np.asarray(picture) // STEP * STEP + STEP // 2).astype(np.uint8)
    Image.fromarray(coarse).save(path, optimize=True)
    sys.stdout.write(f"{path} {path.stat().st_size / 1000:.0f} kB\n")


def _grid(cells: Sequence[Cell], side: int, columns: int) -> Image.Image:
    rows = -(-len(cells) // columns)
    sheet = Image.new("RGB", (columns * (side + 2), rows * (side + LABEL_PX + 2)), "white")
    pen = ImageDraw.Draw(sheet)
    for number, (label, pixels) in enumerate(cells):
        x, y = number % columns * (side + 2), number // columns * (side + LABEL_PX + 2)
        sheet.paste(Image.fromarray(pixels), (x, y))
        pen.text((x + 2, y + side), label, fill="black")
    return sheet


def _looking(state: WorldState, yaw: float) -> WorldState:
    """Return the moment with the agent where it sees most of the room in a direction."""
    sine, cosine = math.sin(math.radians(yaw)), math.cos(math.radians(yaw))
    cells = np.array(list(state.room.cells.values()))
    off = np.abs((cells - cells.mean(axis=0)) @ np.array([cosine, -sine]))
    x, z = cells[int(np.argmin(cells @ np.array([sine, cosine]) + 0.3 * off))]
    place = (float(x), state.pose.position_m[1], float(z))
    return replace(state, pose=replace(state.pose, position_m=place, yaw_deg=yaw, horizon_deg=15.0))


def _rooms() -> Iterator[Cell]:
    for name in ROOMS:
        state = begin(load(name), Settings())
        for yaw in (0.0, 90.0, 180.0):
            now = _looking(state, yaw)
            yield f"{name}, yaw {yaw:.0f}", render(now, agent_camera(now), 260, 260).rgb
        (x, y, z), (width, height, depth) = state.room.bounds_center, state.room.bounds_size
        over = Camera(
            position_m=(x, y + height / 2 + 1.0, z),
            rotation_deg=(90.0, 0.0, 0.0),
            orthographic=True,
            orthographic_size_m=max(width, depth) / 2,
        )
        yield f"{name}, map view", render(state, over, 260, 260).rgb


def _panels() -> Iterator[Cell]:
    now = _looking(begin(load("kitchen_1"), Settings()), 90.0)
    picture = render(now, agent_camera(now), 300, 300, normals=True)
    near = 255 * (1 - np.clip(picture.depth_m / picture.depth_m.max(), 0, 1))
    yield "rgb", picture.rgb
    yield "depth, near is bright", np.repeat(near.astype(np.uint8)[..., None], 3, axis=2)
    yield "instances", instance_frame(picture.rows, now.objects)
    yield "classes", class_frame(picture.rows, now.objects)
    assert picture.normals is not None
    yield "normals", (127.5 * (picture.normals + 1)).astype(np.uint8)


def _shot(kind: str, side: int, **state: Any) -> np.ndarray:
    """Return a close-up of one object on the floor of an empty room."""
    row = object_types()[kind]
    middle: Vec3 = (0.0, row.size_m[1] / 2, 0.0)
    one = SceneObject(
        id=f"{kind}|+00.00|+00.00|+00.00", type=kind, name=kind, position=middle, center=middle,
        size=row.size_m, capabilities=row.capabilities, **state,
    )  # fmt: skip
    room = row.rooms[0] if row.rooms else "Kitchen"
    scene = Scene(
        name="sheet", room=room, source="scripts/make_pictures.py", objects=(one,),
        agent=AgentPose(position=(-3.5, 0.9, 3.5)), reachable=((0.0, 2.0),),
        bounds_center=(0.0, 1.5, 0.0), bounds_size=(8.0, 3.0, 8.0),
    )  # fmt: skip
    down, turn = math.radians(28), math.radians(160)
    ahead = (math.sin(turn) * math.cos(down), -math.sin(down), math.cos(turn) * math.cos(down))
    far = max(math.hypot(*row.size_m) / 2, 0.03) * 3.0
    x, y, z = (a - b * far for a, b in zip(middle, ahead, strict=True))
    camera = Camera(position_m=(x, y, z), rotation_deg=(28.0, 160.0, 0.0), fov_deg=44.0)
    # four rays for each pixel
    fine = render(begin(scene, Settings()), camera, side * 2, side * 2).rgb.astype(np.uint16)
    return (fine.reshape(side, 2, side, 2, 3).sum(axis=(1, 3)) // 4).astype(np.uint8)


def _states() -> Iterator[Cell]:
    for kind, row in object_types().items():
        for capability, (label, change) in STATES.items():
            if capability in row.capabilities and (kind, label) != ("Egg", "broken"):
                before = {"openness": 1.0} if kind == "Laptop" and label != "open" else {}
                yield kind, _shot(kind, 104, **before)
                yield f"{kind} {label}"[:20], _shot(kind, 104, **{**before, **change})
    for kind, label, change in EXTRA:
        yield kind, _shot(kind, 104)
        yield f"{kind} {label}", _shot(kind, 104, **change)


if __name__ == "__main__":
    go_offline()
    main()
