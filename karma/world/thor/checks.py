"""Check one by one what AI2-THOR needs on this machine.

Only looks: nothing is started, written for longer than the look, or fetched; the one connection is
to an X server of this machine.
"""

import ctypes.util
import os
import platform as machine
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from karma.errors import KarmaError
from karma.world.thor import builds
from karma.world.thor.builds import Build, Platform

Status = Literal["ok", "note", "problem"]
RUN_BYTES, UNPACK_BYTES = 200 << 20, 3 << 30
DEPTH_BITS = 24
SIDE_PX = 300  # of the pictures, where none is asked for


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckResult:
    """One condition: whether it holds, what was found, and the command that mends it."""

    name: str
    status: Status
    found: str
    fix: str = ""

    @classmethod
    def of(
        cls, name: str, good: bool, found: str, fix: str = "", *, else_: Status = "problem"
    ) -> "CheckResult":
        """Return a condition; `fix` is left out where it holds."""
        return cls(name=name, status="ok" if good else else_, found=found, fix="" if good else fix)


def examine(
    executable: str | Path | None = None,
    platform: Platform | None = None,
    display: str | None = None,
) -> list[CheckResult]:
    """Return every condition, in the order in which they matter; arguments as for `ThorWorld`."""
    try:
        build, why = builds.locate(executable, platform), ""
    except KarmaError as error:
        build, why = None, str(error)
    draws_with = build.platform if build else builds.candidates(platform)[0]
    return [
        *_system(),
        *(_no_build(why, draws_with) if build is None else _build(build)),
        *_drawing(build, draws_with, display or os.environ.get("DISPLAY")),
        *_folders(unpacked=build is not None),
    ]


def _system() -> Iterator[CheckResult]:
    here = f"{machine.system()} {machine.machine()}, Python {machine.python_version()}"
    good = machine.system() in ("Linux", "Darwin") and machine.machine() in ("x86_64", "arm64")
    fix = "use a machine with 64-bit Linux on x86_64: there is no other build"
    yield CheckResult.of("system", good, here, fix)
    found = builds.package()
    yield CheckResult.of("package ai2thor", found == builds.VERSION, found, builds.INSTALL)


def _no_build(why: str, platform: Platform) -> Iterator[CheckResult]:
    reason, _, fix = why.partition("\n")
    fix = fix.rpartition("To fix: ")[2] if "To fix" in fix else builds.fetch(platform)
    yield CheckResult.of("build", False, reason, fix)


def _build(build: Build) -> Iterator[CheckResult]:
    yield CheckResult.of("build", True, f"{build.path} ({build.origin})")
    bit = "set" if build.runs else "not set"
    yield CheckResult.of("executable bit", build.runs, bit, build.make_run)
    data = build.path.parent / f"{build.path.stem}_Data"
    there = data.is_dir()
    found, fix = str(data) if there else f"no {data}", f"unzip the build again into {data.parent}"
    if build.is_command or build.platform == "OSXIntel64":
        there, found = True, "not looked for beside a command"
    yield CheckResult.of("_Data folder", there, found, fix)


def _drawing(build: Build | None, platform: Platform, display: str | None) -> Iterator[CheckResult]:
    yield CheckResult(name="platform", status="ok", found=platform)
    if platform == "CloudRendering":
        library = ctypes.util.find_library("vulkan")
        fix = "apt-get install libvulkan1, and the graphics card's driver"
        yield CheckResult.of("Vulkan", library is not None, library or "no libvulkan", fix)
    elif platform == "Linux64":
        finding = _display(display)
        if build is not None and build.is_command and finding.status == "problem":
            finding = replace(finding, status="note", found=f"{finding.found}; a command may do")
        yield finding


def _display(given: str | None) -> CheckResult:
    display = given or next(iter(builds.screens()), None)
    start = "sudo ai2thor-xorg start   (NVIDIA), then export DISPLAY=:0"
    if display is None:
        return CheckResult.of("X display", False, "no $DISPLAY, no X server on this machine", start)
    if display.partition(":")[0] not in ("", "unix", "localhost"):
        found = f"{display} is another machine's: not connected to"
        return CheckResult.of("X display", False, found, "export DISPLAY=:0")
    wrong = _screen(display)
    shown = display if given else f"{display} (the first here; $DISPLAY is not set)"
    return CheckResult.of("X display", not wrong, f"{shown}: {wrong or 'GLX, 24 bits'}", start)


def _screen(display: str) -> str:
    """Return what is wrong with a display, "" if nothing."""
    try:
        import Xlib.display
        import Xlib.error
    except ImportError:
        return "cannot be looked at without python-xlib, which comes with ai2thor"
    try:
        connection = Xlib.display.Display(display)
    except (Xlib.error.DisplayError, Xlib.error.ConnectionClosedError, OSError) as error:
        return f"cannot be reached: {error}"
    screen = connection.screen()
    wrong = []
    if "GLX" not in connection.list_extensions():
        wrong.append("no GLX")
    if screen.root_depth != DEPTH_BITS:
        wrong.append(f"{screen.root_depth} bits deep, not {DEPTH_BITS}")
    if min(screen.width_in_pixels, screen.height_in_pixels) < SIDE_PX:
        wrong.append(f"only {screen.width_in_pixels} x {screen.height_in_pixels} pixels")
    connection.close()
    return ", ".join(wrong)


def _folders(*, unpacked: bool) -> Iterator[CheckResult]:
    folder = builds.home()
    existing = next(one for one in (folder, *folder.parents) if one.exists())
    writable = False
    with suppress(OSError), tempfile.TemporaryFile(dir=existing):
        writable = True
    found = str(folder) if writable else f"{folder} cannot be written"
    yield CheckResult.of("home folder", writable, found, "export HOME=/a/folder/you/may/write")
    free, need = shutil.disk_usage(existing).free, RUN_BYTES if unpacked else UNPACK_BYTES
    what = "to run" if unpacked else "to unpack a build"
    found = f"{free / 2**30:.1f} GiB free; {need / 2**30:.1f} GiB {what}"
    yield CheckResult.of("disk", free >= need, found, f"free some space in {folder}")
