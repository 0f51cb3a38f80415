"""The picture of a room from above."""

from matplotlib import pyplot
from matplotlib.image import imread

from karma.world.core.scene import load
from karma.world.render.top_down import draw_top_down


def test_draw_top_down_writes_a_picture_with_colours(tmp_path):
    path = tmp_path / "new" / "room.png"
    draw_top_down(load("bathroom_1"), path)
    picture = imread(path)
    assert picture.shape[0] > 500
    assert picture.shape[1] > 500
    assert pyplot.get_fignums() == []  # no global figure is left
    assert len({tuple(row) for row in (picture[::7, ::7, :3] * 20).astype(int).reshape(-1, 3)}) > 8


def test_draw_top_down_same_scene_gives_same_bytes(tmp_path):
    for name in ("a.png", "b.png"):
        draw_top_down(load("bathroom_2"), tmp_path / name)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
