"""Check one by one what AI2-THOR needs on this machine.

Only looks: nothing is started, written for longer than the look, or fetched; the one connection is
to an X server of this machine.
"""

import ctypes.util
import fcntl
import os
import platform as machine
import shlex
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from karma.errors import KarmaError
from karma.world.thor import builds
from karma.world.thor.builds import Build, Platform

Status = Literal["ok", "note", "problem"]
KEPT = 3  # releases that the plain client leaves
RUN_BYTES, UNPACK_BYTES = 200 << 20, 3 << 30
DEPTH_BITS = 24


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """What is asked about.

    `build` is None when there is none, and `why` says why; `platform` is what would be drawn with.
    """

    build: Build | None
    why: str
    platform: Platform
    display: str | None
    size: tuple[int, int] = (300, 300)


def examine(
    executable: str | Path | None = None,
    platform: Platform | None = None,
    display: str | None = None,
) -> list[CheckResult]:
    """Return every condition, in the order in which they matter.

    Args:
        executable: as for `ThorWorld`.
        platform: as for `ThorWorld`.
        display: as for `ThorWorld`.
    """
    build, why = None, ""
    try:
        build = builds.locate(executable, platform)
    except KarmaError as error:
        why = str(error)
    case = Case(
        build=build,
        why=why,
        platform=build.platform if build else builds.candidates(platform)[0],
        display=display or os.environ.get("DISPLAY"),
    )
    return [finding for check in CHECKS for finding in check(case)]


# ----------------------------------------------------------------- package and system


def _system(case: Case) -> Iterator[CheckResult]:
    here = f"{machine.system()} {machine.machine()}, Python {machine.python_version()}"
    good = machine.system() in ("Linux", "Darwin") and machine.machine() in ("x86_64", "arm64")
    fix = "use a machine with 64-bit Linux on x86_64: there is no other build"
    yield CheckResult.of("system", good, here, fix)


def _package(case: Case) -> Iterator[CheckResult]:
    found = builds.package()
    yield CheckResult.of("package ai2thor", found == builds.VERSION, found, builds.INSTALL)


# ----------------------------------------------------------------- the build


def _build(case: Case) -> Iterator[CheckResult]:
    if case.build is None:
        reason, _, fix = case.why.partition("\n")
        fix = fix.rpartition("To fix: ")[2] if "To fix" in fix else builds.fetch(case.platform)
        yield CheckResult.of("build", False, reason, fix)
        return
    build = case.build
    from_where = {"argument": "given", "environment": f"${builds.VARIABLE}", "cache": "cache"}
    yield CheckResult.of("build", True, f"{build.path} ({from_where[build.origin]})")
    yield CheckResult.of(
        "executable bit", build.runs, "set" if build.runs else "not set", build.make_run
    )
    yield from _beside(build)
    yield from _listing(build)


def _beside(build: Build) -> Iterator[CheckResult]:
    """Look for what Unity reads beside its executable."""
    if build.is_command or build.platform == "OSXIntel64":
        yield CheckResult.of("_Data folder", True, "not looked for beside a command")
        return
    data = build.path.parent / f"{build.path.stem}_Data"
    fix = f"unzip the build again into {build.path.parent}"
    yield CheckResult.of(
        "_Data folder", data.is_dir(), str(data) if data.is_dir() else f"no {data}", fix
    )


def _listing(build: Build) -> Iterator[CheckResult]:
    if build.origin != "cache":
        yield CheckResult.of("metadata.json", True, "not needed for a build that is named")
        return
    folder = builds.home() / "releases" / builds.name(build.platform)
    path = folder / "metadata.json"
    fix = f"echo {shlex.quote(builds.METADATA)} > {shlex.quote(str(path))}"
    found = str(path) if path.is_file() else (
        f"no {path}: the plain client would fetch the whole build again"
    )  # fmt: skip
    yield CheckResult.of("metadata.json", path.is_file(), found, fix)


# ----------------------------------------------------------------- what it draws with


def _drawing(case: Case) -> Iterator[CheckResult]:
    yield CheckResult(name="platform", status="ok", found=case.platform)
    if case.platform == "CloudRendering":
        library = ctypes.util.find_library("vulkan")
        fix = "apt-get install libvulkan1, and the graphics card's driver"
        yield CheckResult.of("Vulkan", library is not None, library or "no libvulkan", fix)
    elif case.platform == "Linux64":
        finding = _display(case)
        if case.build is not None and case.build.is_command and finding.status == "problem":
            finding = replace(finding, status="note", found=f"{finding.found}; a command may do")
        yield finding


def _display(case: Case) -> CheckResult:
    display = case.display or next(iter(builds.screens()), None)
    start = "sudo ai2thor-xorg start   (NVIDIA), then export DISPLAY=:0"
    if display is None:
        return CheckResult.of("X display", False, "no $DISPLAY, no X server on this machine", start)
    if display.partition(":")[0] not in ("", "unix", "localhost"):
        found = f"{display} is another machine's: not connected to"
        return CheckResult.of("X display", False, found, "export DISPLAY=:0")
    wrong = _screen(display, case.size)
    shown = display if case.display else f"{display} (the first here; $DISPLAY is not set)"
    return CheckResult.of("X display", not wrong, f"{shown}: {wrong or 'GLX, 24 bits'}", start)


def _screen(display: str, size: tuple[int, int]) -> str:
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
    if screen.width_in_pixels < size[0] or screen.height_in_pixels < size[1]:
        wrong.append(f"only {screen.width_in_pixels} x {screen.height_in_pixels} pixels")
    connection.close()
    return ", ".join(wrong)


# ----------------------------------------------------------------- traps of the environment


def _variables(case: Case) -> Iterator[CheckResult]:
    name, devices = "CUDA_VISIBLE_DEVICES", os.environ.get("CUDA_VISIBLE_DEVICES", "")
    free = not any(part.strip().isdigit() for part in devices.split(","))
    found = f"{devices}: taken out of the launch; the plain client would call vulkaninfo"
    yield CheckResult.of(name, free, "not set" if free else found, f"unset {name}", else_="note")
    name = "AI2THOR_VISIBILITY_DISTANCE"
    if name in os.environ:
        found = f"{os.environ[name]}: the client adds it to every action"
        yield CheckResult.of(name, False, found, f"unset {name}")


# ----------------------------------------------------------------- folders and disk


def _folders(case: Case) -> Iterator[CheckResult]:
    folder = builds.home()
    writable = _can_write(folder)
    found = str(folder) if writable else f"{folder} cannot be written"
    yield CheckResult.of("home folder", writable, found, "export HOME=/a/folder/you/may/write")
    yield CheckResult.of("pipes", *_pipes())
    yield _disk(case, folder)


def _existing(folder: Path) -> Path:
    """Return a folder, or where it would be made."""
    return next(one for one in (folder, *folder.parents) if one.exists())


def _can_write(folder: Path) -> bool:
    with suppress(OSError), tempfile.TemporaryFile(dir=_existing(folder)):
        return True
    return False


def _pipes() -> tuple[bool, str, str]:
    try:
        with tempfile.TemporaryDirectory() as folder:
            os.mkfifo(Path(folder) / "pipe")
    except OSError as error:
        return False, f"{tempfile.gettempdir()}: {error.strerror}", "export TMPDIR=/another/folder"
    return True, f"can be made in {tempfile.gettempdir()}", ""


def _disk(case: Case, folder: Path) -> CheckResult:
    free = shutil.disk_usage(_existing(folder)).free
    need = RUN_BYTES if case.build else UNPACK_BYTES
    what = "to run" if case.build else "to unpack a build"
    found = f"{free / 2**30:.1f} GiB free; {need / 2**30:.1f} GiB {what}"
    return CheckResult.of("disk", free >= need, found, f"free some space in {folder}")


def _releases(case: Case) -> Iterator[CheckResult]:
    folder = builds.home() / "releases"
    count = sum(path.is_dir() for path in folder.iterdir()) if folder.is_dir() else 0
    few, text = count <= KEPT, f"{count} in {folder}"
    if not few:
        text += f": the plain client deletes all but the {KEPT} newest at its next start"
    fix = f"keep builds elsewhere and export {builds.VARIABLE}=/path/to/the/executable"
    yield CheckResult.of("releases", few, text, fix, else_="note")
    files = sorted({*folder.glob("*.lock"), *(folder.parent / "tmp").glob("*.lock")})
    held = [str(path) for path in files if _held(path)]
    found = f"{len(files)} left over, none held" if files else "none"
    if held:
        found = f"{len(held)} of {len(files)} held by a running process: {held[0]}"
    fix = f"fuser -v {shlex.quote(''.join(held[:1]))}   (and end what should not run)"
    yield CheckResult.of("lock files", not held, found, fix, else_="note")


def _held(path: Path) -> bool:
    """Return whether another process has a lock on a file; takes it for a moment."""
    try:
        with path.open("r+b") as file:
            fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            fcntl.lockf(file, fcntl.LOCK_UN)
    except OSError as error:
        return isinstance(error, BlockingIOError)
    return False


CHECKS: tuple[Callable[[Case], Iterator[CheckResult]], ...] = (
    _system, _package, _build, _drawing, _variables, _folders, _releases,
)  # fmt: skip
