"""Find the Unity build, and check one by one what AI2-THOR needs on this machine.

A build is an argument, $KARMA_THOR_BUILD, or in AI2-THOR's own cache. This only looks: nothing is
started or fetched, or written for longer than the look; the one connection is to an X server here.
"""

import ctypes.util
import os
import platform as machine
import shlex
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Literal

from karma.errors import KarmaError

VERSION = "5.0.0"
COMMIT = "f0825767cd50d69f666c7f282e54abfe58f1e917"  # the build that the package 5.0.0 belongs to
VARIABLE = "KARMA_THOR_BUILD"
SOURCE = "http://s3-us-west-2.amazonaws.com/ai2-thor-public/builds"  # for people; never opened here
SIZE = "about half a gigabyte"
INSTALL = f"pip install --no-index --find-links WHEELS ai2thor=={VERSION}"

Platform = Literal["Linux64", "CloudRendering", "OSXIntel64"]
Origin = Literal["given", "$KARMA_THOR_BUILD", "cache"]
PLATFORMS: tuple[Platform, ...] = Platform.__args__  # type: ignore[attr-defined]


@dataclass(frozen=True, slots=True, kw_only=True)
class Build:
    """What to launch."""

    path: Path  # of the executable
    command: tuple[str, ...]  # it, and arguments
    platform: Platform
    origin: Origin

    @property
    def runs(self) -> bool:
        """Whether this user may execute it."""
        return os.access(self.path, os.X_OK)

    @property
    def is_command(self) -> bool:
        """Whether it has arguments: then it is what starts a player, not Unity itself."""
        return len(self.command) > 1

    @property
    def make_run(self) -> str:
        """The command that makes it executable."""
        return f"chmod +x {shlex.quote(str(self.path))}"


def package() -> str:
    """Return which `ai2thor` is installed, in words where none is."""
    try:
        return version("ai2thor")
    except PackageNotFoundError:
        return "not installed"


def check_package() -> None:
    """Refuse to go on without the package.

    Raises:
        KarmaError: it is missing, or another version; says what to do.
    """
    if (found := package()) != VERSION:
        raise KarmaError(
            f"the package `ai2thor` is {found}; this world needs {VERSION}\n  To fix: {INSTALL}"
        )


def home() -> Path:
    """Return the client's own folder, ~/.ai2thor."""
    return Path("~/.ai2thor").expanduser()


def name(platform: Platform) -> str:
    """Return a build's name, of which its folder, zip and executable are called.

    >>> name("CloudRendering")[:24]
    'thor-CloudRendering-f082'
    """
    return f"thor-{platform}-{COMMIT}"


def cached(platform: Platform) -> Path:
    """Return where the client's cache has the executable of a platform."""
    folder = home() / "releases" / name(platform)
    if platform != "OSXIntel64":
        return folder / name(platform)
    return folder / f"{name(platform)}.app" / "Contents" / "MacOS" / "AI2-Thor"


def candidates(platform: Platform | None = None) -> tuple[Platform, ...]:
    """Return the platforms of this machine, the preferred one first."""
    if platform is not None:
        return (platform,)
    if sys.platform == "darwin":
        return ("OSXIntel64",)
    screen = "DISPLAY" in os.environ or any(screens())
    return ("Linux64", "CloudRendering") if screen else ("CloudRendering", "Linux64")


def screens() -> list[str]:
    """Return the X displays of this machine, by their sockets, e.g. [":0"]."""
    names = [path.name[1:] for path in Path("/tmp/.X11-unix").glob("X*")]
    return [f":{number}" for number in sorted(int(name) for name in names if name.isdigit())]


def find(executable: str | Path | None = None, platform: Platform | None = None) -> Build:
    """Return the build to launch; as `locate`.

    Raises:
        KarmaError: there is none, or it cannot be run; says what to do.
    """
    build = locate(executable, platform)
    if not build.runs:
        raise KarmaError(f"{build.path}: not executable\n  To fix: {build.make_run}")
    return build


def locate(executable: str | Path | None = None, platform: Platform | None = None) -> Build:
    """Return the build that lies there, whether it can be run or not; arguments as of `ThorWorld`.

    Raises:
        KarmaError: there is none; says what to do.
    """
    if executable is not None:
        return _given(executable, platform, "given")
    if os.environ.get(VARIABLE):
        return _given(os.environ[VARIABLE], platform, "$KARMA_THOR_BUILD")
    for one in candidates(platform):
        path = cached(one)
        if path.is_file():
            return Build(path=path, command=(str(path),), platform=one, origin="cache")
    looked = "\n".join(f"    {cached(one)}" for one in candidates(platform))
    raise KarmaError(
        f"no Unity build of AI2-THOR {VERSION} is on this machine\n  Looked for, with ${VARIABLE} "
        f"not set:\n{looked}\n  To fix: {fetch(candidates(platform)[0])}\n"
        f"  or, if it lies elsewhere: export {VARIABLE}=/path/to/its/executable"
    )


def fetch(platform: Platform) -> str:
    """Return how a build comes here, for a person to do."""
    folder, zipped = cached(platform).parent, f"{name(platform)}.zip"
    return (
        f"on a machine with a network, fetch {SOURCE}/{zipped} ({SIZE}); carry it here, then\n"
        f"    mkdir -p {folder} && unzip {zipped} -d {folder} && chmod +x {cached(platform)}"
    )


def _given(executable: str | Path, platform: Platform | None, origin: Origin) -> Build:
    path, arguments = Path(executable).expanduser(), list[str]()
    if path.is_dir():
        path = _inside(path)
    elif not path.exists() and not isinstance(executable, Path):
        first, *arguments = _words(executable)
        path = Path(shutil.which(first) or Path(first).expanduser())
    if not path.is_file():
        raise KarmaError(f"{path}: no such executable\n  To fix: export {VARIABLE}=/path/to/it")
    usual: Platform = "OSXIntel64" if sys.platform == "darwin" else "Linux64"
    by_name = next((one for one in PLATFORMS if f"-{one}-" in path.name), usual)
    command = (str(path), *arguments)
    return Build(path=path, command=command, platform=platform or by_name, origin=origin)


def _words(text: str) -> list[str]:
    try:
        words = shlex.split(text)
    except ValueError as error:
        raise KarmaError(f"not a command: {text!r}: {error}") from error
    if not words:
        raise KarmaError("the executable is an empty text")
    return words


def _inside(folder: Path) -> Path:
    """Return the executable of an unpacked build: the file that has a _Data folder beside it."""
    for path in sorted(folder.iterdir()):
        if path.is_file() and (folder / f"{path.stem}_Data").is_dir():
            return path
    same = folder / folder.name
    if same.is_file():
        return same
    raise KarmaError(
        f"{folder}: no Unity build in this folder: no file with a `_Data` folder of its name "
        f"beside it\n  To fix: unzip the build into it, or name the executable itself"
    )


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
        build, why = locate(executable, platform), ""
    except KarmaError as error:
        build, why = None, str(error)
    draws_with = build.platform if build else candidates(platform)[0]
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
    found = package()
    yield CheckResult.of("package ai2thor", found == VERSION, found, INSTALL)


def _no_build(why: str, platform: Platform) -> Iterator[CheckResult]:
    reason, _, fix = why.partition("\n")
    fix = fix.rpartition("To fix: ")[2] if "To fix" in fix else fetch(platform)
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
    display = given or next(iter(screens()), None)
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
    folder = home()
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
