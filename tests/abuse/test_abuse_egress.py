"""A planted plug-in that asks for the network is refused and named, as far as Python can see it."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from support.abuse import Case, all_held

_START = "import socket, sys\nfrom karma.offline.guard import go_offline, settle\ngo_offline()\n"
PLANTED = {
    "connect": "socket.socket().connect(('192.0.2.1', 80))",
    "swallowed": "try: socket.socket().connect(('192.0.2.1', 80))\nexcept BaseException: pass",
    "open to all, any port": "s = socket.socket(); s.bind(('0.0.0.0', 0)); s.listen()",
    "open to all, no name": "s = socket.socket(); s.bind(('', 0)); s.listen()",
    "open to all, version 6": "s = socket.socket(socket.AF_INET6); s.bind(('::', 0)); s.listen()",
    "a packet": "socket.socket(type=socket.SOCK_DGRAM).sendto(b'x', ('192.0.2.1', 9))",
    "at the end": (
        "import atexit\ndef late():\n try: socket.socket().connect(('192.0.2.1', 80))\n"
        " except BaseException: pass\natexit.register(late)"
    ),
    "in a thread": (
        "import threading\n"
        "def ask():\n try: socket.socket().connect(('192.0.2.1', 80))\n"
        " except BaseException: pass\n"
        "t = threading.Thread(target=ask); t.start(); t.join()"
    ),
}  # fmt: skip


def egress(seed: int, count: int) -> Iterator[Case]:
    """Yield planted attempts; the process must fail and name who asked."""
    names = list(PLANTED)
    for number in range(min(count, len(names))):
        name = names[(seed + number) % len(names)]
        yield Case(name=name, attack=_planted(PLANTED[name]))


def _planted(code: str) -> Callable[[Path], None]:
    def attack(folder: Path) -> None:
        plugin = folder / "planted_plugin.py"
        plugin.write_text("import socket, sys\n" + code + "\n")
        program = f"{_START}sys.path.insert(0, {str(folder)!r})\nimport planted_plugin\n"
        done = subprocess.run(
            [sys.executable, "-c", program], capture_output=True, text=True, check=False
        )
        assert done.returncode != 0, "went on, and ended as if nothing had been"
        assert "planted_plugin" in done.stderr, f"not named: {done.stderr[-300:]}"

    return attack


def test_planted_plug_in_is_refused_and_named_and_its_process_fails(tmp_path):
    all_held(egress, len(PLANTED), tmp_path)
