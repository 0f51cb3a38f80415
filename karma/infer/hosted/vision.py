"""A hosted `VisionModel`: the paper's four steps (KARMA §3.4, Fig. 10) and the picture."""

import base64
import hashlib
import struct
import zlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from karma.contracts import Frame, SeenObject
from karma.errors import ModelError
from karma.infer.hosted.model import options_of, said_in, sendable
from karma.infer.hosted.session import Endpoint, Session
from karma.infer.vision.text import again, question, read_answer

MAX_TOKENS = 1024  # four steps of reasoning
ATTEMPTS = 2  # the second quotes what could not be used


class HostedVision:
    """A `VisionModel` at an endpoint that takes pictures.

    Args:
        endpoint: where, and which model; `api` must be "chat".
        session: the run's; by default one without a cassette.

    Raises:
        ModelError: the endpoint is not for chat.
        KarmaError: see `Session.admit`.
    """

    needs_pictures = True

    def __init__(self, endpoint: Endpoint, *, session: Session | None = None) -> None:
        if endpoint.api != "chat":
            raise ModelError(f'{endpoint.model}: pictures need api = "chat"')
        self.name = endpoint.model
        self._endpoint, self._session = endpoint, session or Session()
        self._session.admit(endpoint)

    def read_states(
        self, image: Frame | None, instruction: str, objects: Sequence[SeenObject]
    ) -> Mapping[str, tuple[str, ...]]:
        """Return object id -> state words; objects that the answer leaves out are left out.

        A cassette keeps size and hash of the picture in place of the picture.

        Args:
            image: shape (H, W, 3), RGB.
            instruction: the task.
            objects: of interest; () asks nothing.

        Raises:
            ModelError: there is no picture, the endpoint failed, or its answer has another form.
        """
        if not objects:
            return {}
        if image is None:
            raise ModelError(f"{self.name} reads pictures, and there is none: nothing was rendered")
        role, text = question("full", sendable(instruction), objects)
        whole = {"type": "image_url", "image_url": {"url": picture_url(image)}}
        named = {"type": "image_url", "picture": picture_name(image)}
        later: list[dict[str, Any]] = []
        states: dict[str, tuple[str, ...]] = {}
        for _ in range(ATTEMPTS):
            answer = self._ask(
                _first(role, text, whole) + later, named=_first(role, text, named) + later
            )
            reading = read_answer(answer, objects)
            states |= reading.states
            if not reading.unread:
                break
            later = [
                {"role": "assistant", "content": answer},
                {"role": "user", "content": again(reading, objects)},
            ]
        return states

    def _ask(self, messages: list[dict[str, Any]], *, named: list[dict[str, Any]]) -> str:
        """Return the answer to messages; `named` has the picture's name in its place."""
        options = options_of(self._endpoint, MAX_TOKENS, 0.0, 0)
        exchange = self._session.ask(
            "vision",
            self._endpoint,
            "/chat/completions",
            {"messages": messages, **options},
            named={"messages": named, **options},
        )
        return said_in(exchange.reply.answer or {}, self._endpoint)[0]


def _first(role: str, text: str, picture: Mapping[str, Any]) -> list[dict[str, Any]]:
    return [
        {"role": "system", "content": role},
        {"role": "user", "content": [picture, {"type": "text", "text": text}]},
    ]


def picture_url(image: Frame) -> str:
    """Return a picture as a data URI (PNG).

    Args:
        image: shape (H, W, 3), RGB.
    """
    height, width, _ = image.shape
    rows = np.ascontiguousarray(image, np.uint8).reshape(height, width * 3)
    lines = np.concatenate([np.zeros((height, 1), np.uint8), rows], axis=1)  # 0: no filter

    def chunk(name: bytes, data: bytes) -> bytes:
        check = zlib.crc32(name + data)
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", check)

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    parts = ((b"IHDR", header), (b"IDAT", zlib.compress(lines.tobytes())), (b"IEND", b""))
    data = b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*part) for part in parts)
    return f"data:image/png;base64,{base64.b64encode(data).decode()}"


def picture_name(image: Frame) -> str:
    """Return what stands for a picture in a cassette: size and SHA-256 of its pixels."""
    height, width, _ = image.shape
    pixels = np.ascontiguousarray(image, np.uint8).tobytes()
    return f"{width}x{height} {hashlib.sha256(pixels).hexdigest()}"
