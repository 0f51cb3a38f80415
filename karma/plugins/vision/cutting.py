"""Cut a square around an object out of a picture."""

from collections.abc import Sequence

import numpy as np

from karma.types.space import Frame, Point, Region

LEAST_PX = 32.0  # smaller things are shown with more around them
LINE = (255, 0, 255)
THIN = 60.0  # the square's side over the width of a line in it


def cut(frame: Frame, region: Region, margin: float, silhouette: Sequence[Point] = ()) -> Frame:
    """Return a square around a region of an uint8 frame, black where that ends, shape (s, s, 3).

    Region and silhouette are in pixels: left, top, right, bottom, and corners; a line is drawn
    along these, which tells a drawer from those above and below it. `margin` is the square's side
    over the region's longer side.
    """
    left, top, right, bottom = region
    side = max(1, round(max(right - left, bottom - top, LEAST_PX / margin) * margin))
    x, y = round((left + right - side) / 2), round((top + bottom - side) / 2)
    height, width = frame.shape[:2]
    found = np.zeros((side, side, 3), dtype=np.uint8)
    x0, y0, x1, y1 = max(x, 0), max(y, 0), min(x + side, width), min(y + side, height)
    if x0 < x1 and y0 < y1:
        found[y0 - y : y1 - y, x0 - x : x1 - x] = frame[y0:y1, x0:x1]
    if silhouette:
        found = _drawn(found, [(left - x, top - y) for left, top in silhouette])
    return found


def _drawn(picture: Frame, corners: Sequence[Point]) -> Frame:
    from PIL import Image, ImageDraw

    image = Image.fromarray(picture)
    wide = max(1, round(len(picture) / THIN))
    ImageDraw.Draw(image).line([*corners, corners[0]], fill=LINE, width=wide)
    return np.asarray(image)
