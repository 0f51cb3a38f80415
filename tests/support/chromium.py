"""A headless Chromium, led over a pipe: no driver, no port, no network."""

import base64
import json
import os
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from fcntl import F_DUPFD_CLOEXEC, fcntl
from pathlib import Path
from typing import Any

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--disable-default-apps", "--disable-extensions", "--disable-dev-shm-usage",
    "--disable-domain-reliability", "--no-default-browser-check", "--hide-scrollbars",
    "--host-resolver-rules=MAP * ~NOTFOUND", "--remote-debugging-pipe",
)  # fmt: skip
PATIENCE_S = 60.0


def executable() -> str:
    """The browser; skips where none is."""
    found = next(filter(None, map(shutil.which, NAMES)), None)
    if found is None:
        pytest.skip("needs a browser: install Chromium (Debian: apt install chromium)")
    return found


class Chromium:
    """One tab.

    Args:
        to_browser: file descriptor of the pipe that it reads.
        from_browser: of the one that it writes.
    """

    def __init__(self, to_browser: int, from_browser: int) -> None:
        self._to, self._from = to_browser, from_browser
        self._number, self._rest, self._session = 0, b"", None
        self.events: list[dict[str, Any]] = []
        tab = self.send("Target.createTarget", url="about:blank")["targetId"]
        attached = self.send("Target.attachToTarget", targetId=tab, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.send(f"{domain}.enable")

    def quit(self) -> None:
        """End the browser."""
        self._session = None
        self.send("Browser.close")

    def send(self, method: str, **params: Any) -> dict[str, Any]:
        """Return a command's result; what happens meanwhile is kept in `events`."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": params}
        if self._session is not None:
            message["sessionId"] = self._session
        os.write(self._to, json.dumps(message).encode() + b"\0")
        while (answer := self._read()).get("id") != self._number:
            self.events.append(answer)
        if "error" in answer:
            raise RuntimeError(f"{method}: {answer['error']}")
        return answer["result"]

    def _read(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            data = os.read(self._from, 1 << 20)
            if not data:
                raise RuntimeError("the browser is gone")
            self._rest += data
        line, _, self._rest = self._rest.partition(b"\0")
        return json.loads(line)

    def open(self, address: str) -> None:
        """Load a page and wait until it is there; an address that differs in its # only is new."""
        self.send("Page.navigate", url="about:blank")
        self.events.clear()
        self.send("Page.navigate", url=address)
        end = time.monotonic() + PATIENCE_S
        while not self.value(
            "location.href !== 'about:blank' && document.readyState === 'complete'"
        ):
            assert time.monotonic() < end, f"{address} did not load"

    def value(self, expression: str) -> Any:
        """Return the value of an expression in the page."""
        got = self.send("Runtime.evaluate", expression=expression, returnByValue=True)
        if "exceptionDetails" in got:
            raise AssertionError(got["exceptionDetails"])
        return got["result"].get("value")

    def press(self, key: str, *, shift: bool = False) -> None:
        """Press a key."""
        fields = {"key": key, "code": key, "modifiers": 8 * shift}
        self.send("Input.dispatchKeyEvent", type="keyDown", **fields)
        self.send("Input.dispatchKeyEvent", type="keyUp", **fields)

    def text(self, name: str) -> str:
        """Return what an element shows, by its id."""
        return str(self.value(f"document.getElementById({name!r}).innerText"))

    def click(self, selector: str) -> None:
        """Click into the middle of an element."""
        box = self.value(
            f"(() => {{ const e = document.querySelector({json.dumps(selector)}); "
            "e.scrollIntoView({block: 'center'}); const b = e.getBoundingClientRect(); "
            "return [b.x + b.width / 2, b.y + b.height / 2]; })()"
        )
        for kind in ("mousePressed", "mouseReleased"):
            self.send(
                "Input.dispatchMouseEvent", type=kind, x=box[0], y=box[1], button="left",
                clickCount=1,
            )  # fmt: skip

    def look(self, path: Path, *, width: int, height: int = 900, dark: bool = False) -> None:
        """Write a PNG of the page; height 0 takes in all of it."""
        scheme = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
        self.send("Emulation.setEmulatedMedia", features=scheme)
        metrics = {"width": width, "deviceScaleFactor": 1, "mobile": False}
        self.send("Emulation.setDeviceMetricsOverride", height=height or 900, **metrics)
        if not height:
            whole = self.value("document.documentElement.scrollHeight")
            self.send("Emulation.setDeviceMetricsOverride", height=whole, **metrics)
        data = self.send("Page.captureScreenshot", format="png")["data"]
        path.write_bytes(base64.b64decode(data))

    def requests(self) -> list[str]:
        """Return the addresses that the page asked for since it was opened, data: left out."""
        asked = [e for e in self.events if e.get("method") == "Network.requestWillBeSent"]
        urls = [event["params"]["request"]["url"] for event in asked]
        return [url for url in urls if not url.startswith(("data:", "about:"))]

    def complaints(self) -> list[str]:
        """Return what the browser's console says since the page was opened."""
        found = []
        for event in self.events:
            if event.get("method") == "Runtime.exceptionThrown":
                found.append(str(event["params"]["exceptionDetails"]))
            elif event.get("method") in ("Log.entryAdded", "Runtime.consoleAPICalled"):
                found.append(str(event["params"]))
        return found


@contextmanager
def chromium(profile: Path) -> Iterator[Chromium]:
    """Start a browser with a new profile, and end it."""
    command = [executable(), *FLAGS, f"--user-data-dir={profile}", "about:blank"]
    pipes = [*os.pipe(), *os.pipe()]
    reads, to_browser, from_browser, writes = (fcntl(one, F_DUPFD_CLOEXEC, 100) for one in pipes)
    for one in pipes:
        os.close(one)
    nothing = [(os.POSIX_SPAWN_OPEN, n, os.devnull, os.O_RDWR, 0) for n in (0, 1, 2)]
    ends = [(os.POSIX_SPAWN_DUP2, reads, 3), (os.POSIX_SPAWN_DUP2, writes, 4)]
    process = os.posix_spawn(command[0], command, os.environ, file_actions=[*nothing, *ends])
    os.close(reads)
    os.close(writes)
    browser = None
    try:
        browser = Chromium(to_browser, from_browser)
        yield browser
    finally:
        if browser is not None:
            with suppress(OSError, RuntimeError):
                browser.quit()
        os.close(to_browser)  # which ends it too
        os.close(from_browser)
        os.waitpid(process, 0)
