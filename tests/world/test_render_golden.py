"""Each type, in each of its states, is drawn as it always was: a picture hash each, kept in a file.

The vision weights learnt from these pixels. Who changes a shape on purpose writes the file anew:
`PYTHONPATH=tests python -m world.test_render_golden > tests/golden/pictures.json`.
"""

import hashlib
import json
import os
import subprocess
import sys

import msgspec
from support.paths import GOLDEN, ROOT
from support.stage import close_up
from world.test_render_looks import BEFORE, FLAGS, SHAPED, STATES

from karma.world.render.picture import render

PICTURES = GOLDEN / "pictures.json"


def hashes():
    """SHA-256 of the close-up of each type as it is, in each state, and hot."""
    wanted = [(kind, "", {}) for kind in SHAPED]
    wanted += [(kind, flag, BEFORE.get(kind, {}) | FLAGS[flag]) for kind, flag in STATES]
    wanted += [("Mug", "hot", {"temperature": "Hot"}), ("Apple", "cold", {"temperature": "Cold"})]
    return {f"{kind} {state}".strip(): _hash(kind, more) for kind, state, more in wanted}


def _hash(kind, state):
    now, camera = close_up(kind, **state)
    picture = render(now, camera, 96, 96)
    return hashlib.sha256(picture.rgb.tobytes() + picture.rows.tobytes()).hexdigest()


def test_every_type_looks_as_it_did():
    golden = json.loads(PICTURES.read_bytes())
    assert [kind for kind, seen in hashes().items() if seen != golden.get(kind)] == []
    assert golden.keys() == hashes().keys()


def test_pictures_are_the_same_under_another_hash_seed():
    env = {
        **os.environ,
        "PYTHONHASHSEED": "77",
        "PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'tests'}",
    }
    code = [sys.executable, "-m", "world.test_render_golden"]
    assert subprocess.run(code, env=env, check=True, capture_output=True).stdout == (
        PICTURES.read_bytes()
    )


if __name__ == "__main__":
    sys.stdout.buffer.write(msgspec.json.format(msgspec.json.encode(hashes()), indent=1) + b"\n")
