"""Check one by one what AI2-THOR needs on this machine.

Only looks: nothing is started, written for longer than the look, or fetched; the one connection is
to an X server of this machine.
"""

import ctypes.util
import os
import platform as machine
import shlex
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Literal

from karma.errors import KarmaError
from karma.world.thor import builds
from karma.world.thor.builds import Build, Platform

Status = Literal["ok", "note", "problem"]
INSTALL = f"pip install --no-index --find-links WHEELS ai2thor=={builds.VERSION}"
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


def works(findings: list[CheckResult]) -> bool:
    """Return whether nothing is a problem."""
    return all(finding.status != "problem" for finding in findings)


# ----------------------------------------------------------------- package and system


def _system(case: Case) -> Iterator[CheckResult]:
    here = f"{machine.system()} {machine.machine()}, Python {machine.python_version()}"
    good = machine.system() in ("Linux", "Darwin") and machine.machine() in ("x86_64", "arm64")
    fix = "" if good else "use a machine with 64-bit Linux on x86_64: there is no other build"
    yield _one("system", good, here, fix)


def _package(case: Case) -> Iterator[CheckResult]:
    try:
        found = version("ai2thor")
    except PackageNotFoundError:
        yield _one("package ai2thor", False, "not installed", INSTALL)
        return
    yield _one("package ai2thor", found == builds.VERSION, found, INSTALL)


# ----------------------------------------------------------------- the build


def _build(case: Case) -> Iterator[CheckResult]:
    if case.build is None:
        reason, _, fix = case.why.partition("\n")
        fix = fix.rpartition("To fix: ")[2] if "To fix" in fix else builds.fetch(case.platform)
        yield _one("build", False, reason, fix)
        return
    build = case.build
    from_where = {"argument": "given", "environment": f"${builds.VARIABLE}", "cache": "cache"}
    yield _one("build", True, f"{build.path} ({from_where[build.origin]})")
    yield _one("executable bit", build.runs, "set" if build.runs else "not set", build.make_run)
    yield from _beside(build)
    yield from _listing(build)


def _beside(build: Build) -> Iterator[CheckResult]:
    """Look for what Unity reads beside its executable."""
    if build.is_command or build.platform == "OSXIntel64":
        yield _one("_Data folder", True, "not looked for beside a command")
        return
    data = build.path.parent / f"{build.path.stem}_Data"
    fix = f"unzip the build again into {build.path.parent}"
    yield _one("_Data folder", data.is_dir(), str(data) if data.is_dir() else f"no {data}", fix)


def _listing(build: Build) -> Iterator[CheckResult]:
    if build.origin != "cache":
        yield _one("metadata.json", True, "not needed for a build that is named")
        return
    folder = builds.home() / "releases" / builds.name(build.platform)
    path = folder / "metadata.json"
    fix = f"echo {shlex.quote(builds.METADATA)} > {shlex.quote(str(path))}"
    found = str(path) if path.is_file() else (
        f"no {path}: the plain client would fetch the whole build again"
    )  # fmt: skip
    yield _one("metadata.json", path.is_file(), found, fix)


# ----------------------------------------------------------------- what it draws with


def _drawing(case: Case) -> Iterator[CheckResult]:
    yield CheckResult(name="platform", status="ok", found=case.platform)
    if case.platform == "CloudRendering":
        library = ctypes.util.find_library("vulkan")
        fix = "apt-get install libvulkan1, and the graphics card's driver"
        yield _one("Vulkan", library is not None, library or "no libvulkan", fix)
    elif case.platform == "Linux64":
        finding = _display(case)
        if case.build is not None and case.build.is_command and finding.status == "problem":
            finding = replace(finding, status="note", found=f"{finding.found}; a command may do")
        yield finding


def _display(case: Case) -> CheckResult:
    display = case.display or next(iter(builds.screens()), None)
    start = "sudo ai2thor-xorg start   (NVIDIA), then export DISPLAY=:0"
    if display is None:
        return _one("X display", False, "no $DISPLAY, no X server on this machine", start)
    if display.partition(":")[0] not in ("", "unix", "localhost"):
        found = f"{display} is another machine's: not connected to"
        return _one("X display", False, found, "export DISPLAY=:0")
    wrong = _screen(display, case.size)
    shown = display if case.display else f"{display} (the first here; $DISPLAY is not set)"
    return _one("X display", not wrong, f"{shown}: {wrong or 'GLX, 24 bits'}", start)


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
    if any(part.strip().isdigit() for part in devices.split(",")):
        found = f"{devices}: taken out of the launch; the plain client would call vulkaninfo"
        yield CheckResult(name=name, status="note", found=found, fix=f"unset {name}")
    else:
        yield _one(name, True, "not set")
    name = "AI2THOR_VISIBILITY_DISTANCE"
    if name in os.environ:
        found = f"{os.environ[name]}: the client adds it to every action"
        yield _one(name, False, found, f"unset {name}")


# ----------------------------------------------------------------- folders and disk


def _folders(case: Case) -> Iterator[CheckResult]:
    folder = builds.home()
    writable = _can_write(folder)
    found = str(folder) if writable else f"{folder} cannot be written"
    yield _one("home folder", writable, found, "export HOME=/a/folder/you/may/write")
    yield _one("pipes", *_pipes())
    yield _disk(case, folder)


def _can_write(folder: Path) -> bool:
    """Return whether something can be made in a folder, or where it would be."""
    while not folder.exists():
        folder = folder.parent
    with suppress(OSError), tempfile.TemporaryFile(dir=folder):
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
    while not folder.exists():
        folder = folder.parent
    free = shutil.disk_usage(folder).free
    need = RUN_BYTES if case.build else UNPACK_BYTES
    what = "to run" if case.build else "to unpack a build"
    found = f"{free / 2**30:.1f} GiB free; {need / 2**30:.1f} GiB {what}"
    return _one("disk", free >= need, found, f"free some space in {folder}")


def _releases(case: Case) -> Iterator[CheckResult]:
    folder = builds.home() / "releases"
    inside = sorted(folder.iterdir()) if folder.is_dir() else []
    found = [path.name for path in inside if path.is_dir()]
    many = len(found) > KEPT
    text = f"{len(found)} in {folder}"
    if many:
        text += f": the plain client deletes all but the {KEPT} newest at its next start"
    fix = f"keep builds elsewhere and export {builds.VARIABLE}=/path/to/the/executable"
    yield CheckResult(
        name="releases", status="note" if many else "ok", found=text, fix=fix if many else ""
    )
    yield _locks(folder)


def _locks(folder: Path) -> CheckResult:
    files = sorted({*folder.glob("*.lock"), *(folder.parent / "tmp").glob("*.lock")})
    held = [path for path in files if _held(path)]
    if held:
        found = f"{len(held)} of {len(files)} held by a running process: {held[0]}"
        fix = f"fuser -v {shlex.quote(str(held[0]))}   (and end what should not run)"
        return CheckResult(name="lock files", status="note", found=found, fix=fix)
    return _one("lock files", True, f"{len(files)} left over, none held" if files else "none")


def _held(path: Path) -> bool:
    """Return whether another process has a lock on a file; takes it for a moment."""
    if sys.platform == "win32":
        return False
    import fcntl

    try:
        with path.open("r+b") as file:
            fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            fcntl.lockf(file, fcntl.LOCK_UN)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


def _one(name: str, good: bool, found: str, fix: str = "") -> CheckResult:
    finding = CheckResult(name=name, status="ok", found=found)
    return finding if good else replace(finding, status="problem", fix=fix)


CHECKS: tuple[Callable[[Case], Iterator[CheckResult]], ...] = (
    _system, _package, _build, _drawing, _variables, _folders, _releases,
)  # fmt: skip
