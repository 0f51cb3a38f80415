"""A scene file that is torn, of the wrong form or inconsistent is refused with the place."""

import msgspec
import pytest

from karma.errors import FileError
from karma.files import to_json
from karma.world.core.scene import SCENES, load


def test_scene_file_of_wrong_form_says_where(tmp_path):
    good = (SCENES / "kitchen_1.json").read_bytes()
    for data, said in [
        (good[:-40], "truncated|Input data|invalid|malformed"),
        (good.replace(b'"reachable":', b'"reachabel":'), "reachabel|reachable"),
        (good.replace(b'"is_toggled":true', b'"is_toggled":1'), r"is_toggled|\$\.objects"),
    ]:
        path = tmp_path / "broken.json"
        path.write_bytes(data)
        with pytest.raises(FileError, match=said) as caught:
            load(path)
        assert caught.value.path == path


def test_scene_file_inconsistent_names_the_object(tmp_path):
    scene = load("bathroom_1")
    first, second, *rest = scene.objects
    lost = msgspec.structs.replace(second, parents=("Nowhere|1|2|3",))
    for objects, said in [
        ((first, first, *rest), "stands twice"),
        ((first, lost, *rest), "Nowhere"),
        ((first, msgspec.structs.replace(second, name=first.name), *rest), "not unique"),
    ]:
        path = tmp_path / "broken.json"
        path.write_bytes(to_json(msgspec.structs.replace(scene, objects=objects)))
        with pytest.raises(FileError, match=said):
            load(path)
