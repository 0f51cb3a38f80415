"""An evaluation as one HTML page: figures, confusion, pictures of failures; nothing external."""

import base64
from collections.abc import Sequence
from pathlib import Path

from karma.agent.seeing.picture_states import png
from karma.train.vision.score import AskedCrop, Score

TEMPLATE = Path(__file__).parent / "page.html.j2"
MOST_FAILURES = 120


def page(score: Score, asked: Sequence[AskedCrop]) -> str:
    """Return the page.

    Args:
        score: the figures.
        asked: the answers they are of; failures bring their pictures.
    """
    from jinja2 import Environment, StrictUndefined

    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, keep_trailing_newline=True
    )
    wrong = sorted((one for one in asked if not one.right), key=lambda one: -one.share)
    types = sorted(score.types.items(), key=lambda item: (item[1].value or 0.0, item[0]))
    return environment.from_string(TEMPLATE.read_text(encoding="utf-8")).render(
        score=score,
        rooms=list(dict.fromkeys(one.room for one in asked)),
        types=types,
        wrong=len(wrong),
        failures=[_card(one) for one in wrong[:MOST_FAILURES]],
        figure=lambda value: "–" if value is None else f"{value:.3f}",
        ms=lambda value: "–" if value is None else f"{value:.0f}",
    )


def _card(one: AskedCrop) -> dict[str, object]:
    picture = "" if one.picture is None else base64.b64encode(png(one.picture)).decode()
    return {
        "object_type": one.object_type,
        "room": one.room,
        "frame": one.frame,
        "share": one.share,
        "truth": ", ".join(one.truth),
        "said": "no usable answer" if one.said is None else ", ".join(one.said),
        "picture": f"data:image/png;base64,{picture}",
    }
