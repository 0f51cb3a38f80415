"""Bundles and wheels made by hand, small, also wrong ones."""

import hashlib
import io
import json
import tarfile
import zipfile

from karma.plugins.airgap.install import ABOUT, SUMS, here


def wheel_bytes(name="small", version="1.0", *, needs=(), extra=(), module=True):
    """A wheel of one module or none, with a licence."""
    info = f"{name}-{version}.dist-info"
    lines = ["Metadata-Version: 2.4", f"Name: {name}", f"Version: {version}"]
    lines += ["License-Expression: MIT", *(f"Requires-Dist: {need}" for need in needs)]
    files = {
        **({f"{name}.py": f"WORD = {name!r}\n"} if module else {}),
        **dict(extra),
        f"{info}/METADATA": "\n".join(lines) + "\n\n",
        f"{info}/WHEEL": "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        f"{info}/licenses/LICENSE": "Do what you like.\n",
    }
    record = "".join(f"{path},,\n" for path in [*files, f"{info}/RECORD"])
    sink = io.BytesIO()
    with zipfile.ZipFile(sink, "w", zipfile.ZIP_DEFLATED) as file:
        for path, text in {**files, f"{info}/RECORD": record}.items():
            file.writestr(zipfile.ZipInfo(path), text, compress_type=zipfile.ZIP_DEFLATED)
    return sink.getvalue()


def pack(files, *, about=None, sums=None, more=()):
    """A bundle by hand; `sums` in place of what is listed, `more` members without content."""
    machine = dict(zip(("python", "platform"), here(), strict=True))
    said = json.dumps({"karma": "0.1.0", "models": [], **machine, **(about or {})}).encode()
    pairs = [(ABOUT, said), *(files.items() if isinstance(files, dict) else files)]
    right = {path: hashlib.sha256(data).hexdigest() for path, data in pairs}
    listed = right if sums is None else {ABOUT: right[ABOUT], **sums}
    lines = "".join(f"{digest}  {path}\n" for path, digest in listed.items())
    members = [(tarfile.TarInfo(path), data) for path, data in [*pairs, (SUMS, lines.encode())]]
    sink = io.BytesIO()
    with tarfile.open(fileobj=sink, mode="w", format=tarfile.GNU_FORMAT) as tar:
        for info, data in [*((one, b"") for one in more), *members]:
            info.size = len(data)
            tar.addfile(info, io.BytesIO(data))
    return sink.getvalue()
