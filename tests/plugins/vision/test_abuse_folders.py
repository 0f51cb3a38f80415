"""A brought model folder with a value that no library expects is refused by name, or opens."""

import json
import random
import shutil
import tempfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from support.abuse import Case, all_held, stream

from karma.errors import KarmaError

_VALUES: tuple[object, ...] = (
    None, True, False, 0, -1, 7, 1.5, 1e308, -1e308, 10**18, 1 << 31, "", "x", "\x1b[2J[/red]",
    "../../x", [], {}, [[]], {"a": 1}, ["x"], [0], "gelu", 1e-320, "{{ 9**9**9 }}",
)  # fmt: skip
FRAME = np.full((16, 16, 3), 90, np.uint8)


def _sentence(folder: Path) -> None:
    from karma.plugins.vision.sentence import SentenceEmbedder

    SentenceEmbedder(folder).embed(["red apple"])


def _clip(folder: Path) -> None:
    from karma.plugins.vision.clip import ClipEmbedder

    one = ClipEmbedder(folder)
    one.embed(["red apple"])
    one.embed_images([FRAME])


def _vision(folder: Path) -> None:
    from karma.plugins.vision.vlm import TransformersVision, VisionOptions

    TransformersVision(folder, options=VisionOptions(max_tokens=2))


@cache
def _sound(name: str) -> Path:
    """Return a folder that opens; made once per process."""
    from support import tiny_models, tiny_vision

    make: dict[str, Callable[[Path], Path]] = {
        "sentence": tiny_models.save_sentence,
        "clip": tiny_models.save_clip,
        "siglip": tiny_models.save_siglip,
        "vision": lambda folder: tiny_vision.save_family("smolvlm", folder),
    }
    folder = Path(tempfile.mkdtemp(prefix="sound-")) / name
    folder.mkdir()
    return make[name](folder)


OPENED: dict[str, Callable[[Path], None]] = {
    "sentence": _sentence, "clip": _clip, "siglip": _clip, "vision": _vision,
}  # fmt: skip


def folders(seed: int, count: int) -> Iterator[Case]:
    """Yield folders of which one value is another; they open, or are refused by name."""
    rng = stream(seed, "folders")
    names = list(OPENED)
    for number in range(count):
        name, draw = names[number % len(names)], rng.randrange(1 << 30)
        yield Case(name=f"{name} {number}", attack=_attack(name, draw))


def _attack(name: str, seed: int) -> Callable[[Path], None]:
    def attack(place: Path) -> None:
        folder = place / "brought"
        shutil.copytree(_sound(name), folder)
        what = _spoil(folder, random.Random(seed))
        try:
            OPENED[name](folder)
        except KarmaError as error:
            said = str(error)
            assert "brought" in said, f"{what}: does not name the folder: {said[:200]}"
            assert len(said) < 2000, f"{what}: a message of any length"
        except Exception as error:
            raise AssertionError(f"{what}: {type(error).__name__}: {error}") from error

    return attack


def _spoil(folder: Path, rng: random.Random) -> str:
    """Change one value of one JSON file; returns which."""
    path = rng.choice(sorted(folder.rglob("*.json")))
    whole = json.loads(path.read_text())
    spots = list(_spots(whole))
    if not spots:
        path.write_text("[]")
        return f"{path.name} = []"
    spot, value = rng.choice(spots), rng.choice(_VALUES)
    inner = whole
    for key in spot[:-1]:
        inner = inner[key]
    inner[spot[-1]] = value
    path.write_text(json.dumps(whole))
    return f"{path.name}: {spot} = {value!r}"


def _spots(value: Any, above: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield where values stand; of vocabularies and other long lists the first few only."""
    keys = list(value) if isinstance(value, dict) else range(len(value))
    for key in list(keys)[: 3 if len(keys) > 60 or isinstance(value, list) else None]:
        yield (*above, key)
        if isinstance(value[key], dict | list):
            yield from _spots(value[key], (*above, key))


def test_model_folder_with_any_value_is_refused_by_name_or_opens(tmp_path):
    all_held(folders, 30, tmp_path)
