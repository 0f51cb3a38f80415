"""Find the Unity build, and check one by one what AI2-THOR needs on this machine.

A build is an argument, $KARMA_THOR_BUILD, or in AI2-THOR's own cache. This only looks: nothing is
started, fetched or written.
"""

import ctypes.util
import os
import shlex
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
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

Platform = Literal["Linux64", "CloudRendering"]
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
    return home() / "releases" / name(platform) / name(platform)


def candidates(platform: Platform | None = None) -> tuple[Platform, ...]:
    """Return the platforms of this machine, the preferred one first."""
    if platform is not None:
        return (platform,)
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
    by_name = next((one for one in PLATFORMS if f"-{one}-" in path.name), PLATFORMS[0])
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
    found = package()
    results = [CheckResult.of("package ai2thor", found == VERSION, found, INSTALL)]
    try:
        build = locate(executable, platform)
    except KarmaError as error:
        reason, _, fix = str(error).partition("\n")
        fix = fix.rpartition("To fix: ")[2] or fetch(candidates(platform)[0])
        return [*results, CheckResult.of("build", False, reason, fix)]
    return [*results, *_build(build), _drawing(build, display)]


def _build(build: Build) -> Iterator[CheckResult]:
    yield CheckResult.of("build", True, f"{build.path} ({build.origin}, {build.platform})")
    bit = "set" if build.runs else "not set"
    yield CheckResult.of("executable bit", build.runs, bit, build.make_run)
    if len(build.command) > 1:
        return
    data = build.path.parent / f"{build.path.stem}_Data"
    fix = f"unzip the build again into {data.parent}"
    yield CheckResult.of(
        "_Data folder", data.is_dir(), str(data) if data.is_dir() else f"no {data}", fix
    )


def _drawing(build: Build, display: str | None) -> CheckResult:
    """Return whether what the build draws with is here."""
    if build.platform == "CloudRendering":
        library = ctypes.util.find_library("vulkan")
        fix = "apt-get install libvulkan1, and the graphics card's driver"
        return CheckResult.of("Vulkan", library is not None, library or "no libvulkan", fix)
    shown = display or os.environ.get("DISPLAY") or next(iter(screens()), "")
    fix = "sudo ai2thor-xorg start   (NVIDIA), then export DISPLAY=:0"
    return CheckResult.of(
        "X display", bool(shown), shown or "no $DISPLAY, no X server on this machine", fix,
        else_="problem" if len(build.command) == 1 else "note",
    )  # fmt: skip
