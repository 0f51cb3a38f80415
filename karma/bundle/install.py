"""Install a verified bundle where there is no network and nothing but Python.

    tar -xOf karma.tar install.pyz > install.pyz
    python3.11 install.pyz karma.tar --into /opt/karma

install.pyz in each bundle holds this module, those it imports and nothing else, so that the code is
the same as that of `karma bundle install`: standard library only.
"""

import argparse
import errno
import hashlib
import os
import platform
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from karma.bundle.contents import CHUNK, BundleError, Contents, Member, open_bundle, places
from karma.bundle.verify import Say, parts, verify

SPARE_BYTES = 64 << 20
PATIENCE_S = 3.0


def install(
    bundle: Path, into: Path, *, sha256: str = "", smoke: bool = True, say: Say = lambda _: None
) -> Contents:
    """Verify a bundle, then install it; killed at any time, the same call goes on.

    Args:
        bundle: the file.
        into: a folder that is new, empty, or where this bundle was being installed.
        sha256: as `verify` has it.
        smoke: afterwards let it carry out one instruction.
        say: is told each step.

    Raises:
        BundleError: refused, or a step failed; `into` then has no `karma` to run.
    """
    say(f"verifying {bundle}")
    contents = verify(bundle, sha256=sha256, say=say)
    _check_here(contents)
    into = Path(os.path.abspath(into))  # noqa: PTH100  (links are kept as they are)
    try:
        into.mkdir(parents=True, exist_ok=True)
        with _alone(into) as lock:
            programs = _Programs(into=into, lock=lock, say=say)
            _claim(into, contents)
            _check_room(into, contents)
            with open_bundle(bundle) as file:
                _unpack(file, contents, into, say)
            _make_venv(contents, programs)
            _write(into / "karma", _launcher(contents), executable=True)
            try:
                _try_out(contents, programs, smoke)
            except BundleError:
                (into / "karma").unlink()
                raise
            _write(into / ".karma-installed", contents.digest.encode() + b"\n")
    except OSError as error:
        raise BundleError(f"{into}: {error}; run the same command again to go on") from error
    say(f"ready: {into / 'karma'} --help")
    return contents


def here() -> tuple[str, str]:
    """Return this machine's Python and platform as manifests name them."""
    major, minor = sys.version_info[:2]
    return f"{major}.{minor}", f"{sys.platform}-{platform.machine()}"


def _check_here(contents: Contents) -> None:
    python, machine = here()
    if contents.platform != machine:
        raise BundleError(f"the bundle is for {contents.platform}, and this machine is {machine}")
    if contents.python != python:
        raise BundleError(
            f"the bundle is for Python {contents.python}, and this is {python}\n"
            f"  To fix: run this with python{contents.python}"
        )


@contextmanager
def _alone(into: Path) -> Iterator[int]:
    """Keep a second installation out; the kernel lets go when this process and its steps are dead.

    Yields the lock's descriptor, which the steps inherit: what a killed installation has started
    may live a moment longer.
    """
    import fcntl

    with open(into / ".karma-lock", "wb", opener=_no_link) as lock:
        until = time.monotonic() + PATIENCE_S
        while True:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                if time.monotonic() > until:
                    raise BundleError(f"{into}: another installation is at work there") from None
                time.sleep(0.05)
            else:
                break
        yield lock.fileno()


def _die_together() -> Callable[[], None] | None:
    """Return what makes a child die with this process, where the system can do that."""
    if not sys.platform.startswith("linux"):
        return None
    import ctypes

    prctl = ctypes.CDLL(None).prctl
    return lambda: prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG


def _claim(into: Path, contents: Contents) -> None:
    """Refuse a folder that holds anything but this bundle's own beginnings."""
    stamp = into / ".karma-bundle"
    if stamp.exists():
        if stamp.read_bytes().strip() != contents.digest.encode():
            raise BundleError(
                f"{into}: another bundle is installed there\n  To fix: choose another folder"
            )
    elif others := sorted(one.name for one in into.iterdir() if not one.name.startswith(".karma-")):
        raise BundleError(f"{into}: not empty, there is {others[0]!r}\n  To fix: another folder")
    _write(stamp, contents.digest.encode() + b"\n")


def _check_room(into: Path, contents: Contents) -> None:
    wanted = SPARE_BYTES
    for member in contents.members:
        there = (into / member.path).exists()
        wanted += (0 if there else member.bytes) + int(1.3 * (member.unpacked or 0))  # bytecode too
    if (into / "venv").exists():
        wanted = 0  # most of it is in use already
    free = shutil.disk_usage(into).free
    if free < wanted:
        raise BundleError(f"{into}: {wanted >> 20} MiB are needed and {free >> 20} MiB are free")


def _unpack(file: BinaryIO, contents: Contents, into: Path, say: Say) -> None:
    """Put every file in its place, whole or not at all; what is there and right is left."""
    root = into.resolve()
    kept = 0
    for number, (member, offset) in enumerate(places(contents), start=1):
        target = into / member.path
        if _is_right(target, member):
            kept += 1
            continue
        target.parent.mkdir(parents=True, exist_ok=True)
        if root not in (target.parent.resolve(), *target.parent.resolve().parents):
            raise BundleError(f"{member.path}: refused, a link leads out of {into}")
        file.seek(offset)
        part, digest = into / ".karma-part", hashlib.sha256()
        with _new(part) as sink:
            for data in parts(file, member.bytes):
                digest.update(data)
                sink.write(data)
            sink.flush()
            os.fsync(sink.fileno())
        if digest.hexdigest() != member.sha256:
            raise BundleError(f"{member.path}: it has changed since it was verified")
        part.chmod(0o755 if member.executable else 0o644)
        part.replace(target)
        if member.bytes > 64 * CHUNK or number % 200 == 0:
            say(f"unpacked {number} of {len(contents.members)}: {member.path}")
    say(f"unpacked {len(contents.members)} files, {kept} of them were there already")


def _is_right(path: Path, member: Member) -> bool:
    try:
        found = path.lstat()
        if not stat.S_ISREG(found.st_mode) or found.st_size != member.bytes:
            return False
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest() == member.sha256
    except OSError:
        return False


@dataclass(frozen=True, slots=True, kw_only=True)
class _Programs:
    """Runs the programs that an installation consists of."""

    into: Path
    lock: int
    say: Say

    def run(self, command: Sequence[str], *, count: bool = False) -> None:
        """Run one; its output goes to the log, with `count` pip's packages are counted aloud."""
        environment = {
            key: value
            for key, value in os.environ.items()
            if not key.startswith(("PIP_", "KARMA_")) and key not in ("PYTHONPATH", "PYTHONHOME")
        }
        environment |= {"PIP_CONFIG_FILE": os.devnull, "PIP_DISABLE_PIP_VERSION_CHECK": "1"}
        path = self.into / ".karma-install.log"
        last: list[str] = []
        with (
            open(path, "a", encoding="utf-8", opener=_no_link) as log,
            tempfile.TemporaryDirectory() as folder,
            subprocess.Popen(
                command,
                cwd=folder,
                env=environment,
                pass_fds=(self.lock,),
                preexec_fn=_die_together(),  # noqa: PLW1509  (this process has one thread)
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                errors="replace",
            ) as child,
        ):
            for number, line in enumerate(child.stdout or ()):
                log.write(line)
                last = [*last[-11:], line]
                if count and (number % 20 == 19 or line.startswith("Installing ")):
                    self.say(f"  {' '.join(line.split())[:70]}")
        if child.returncode != 0:
            raise BundleError(
                f"`{' '.join(map(str, command[:3]))} ...` failed (exit code {child.returncode}):\n"
                f"{''.join(last)}  All of it: {path}"
            )


def _make_venv(contents: Contents, programs: _Programs) -> None:
    """Make the virtual environment from the wheels alone; a half-made one is made again."""
    into, say = programs.into, programs.say
    venv = into / "venv"
    stamp = venv / ".karma-complete"
    if stamp.exists() and stamp.read_bytes().strip() == contents.digest.encode():
        say("the virtual environment is there already")
        return
    if venv.exists():
        _remove(venv)
    wheels = [into / one.path for one in contents.members if one.path.endswith(".whl")]
    pip = next((one for one in wheels if one.name.startswith("pip-")), None)
    say(f"making a virtual environment with {len(wheels)} packages; this takes a while")
    base = getattr(sys, "_base_executable", sys.executable)
    programs.run([base, "-I", "-m", "venv", *(["--without-pip"] if pip else []), str(venv)])
    python = str(venv / "bin" / "python")
    program = [python, str(pip / "pip")] if pip else [python, "-m", "pip"]
    options = ("--no-index", "--no-deps", "--no-cache-dir", "--no-input", "--progress-bar", "off")
    programs.run([*program, "install", *options, *map(str, wheels)], count=True)
    programs.run([*program, "check"])
    _write(stamp, contents.digest.encode() + b"\n")


def _launcher(contents: Contents) -> bytes:
    """Return the shell script that runs karma in its environment, wherever the folder lies."""
    tops = {one.path.split("/")[0] for one in contents.members}
    named = [("KARMA_MODELS", "models"), ("KARMA_SCENES", "scenes"), ("KARMA_THOR_BUILD", "thor")]
    lines = [f': "${{{key}:=$here/{top}}}"; export {key}' for key, top in named if top in tops]
    script = ["#!/bin/sh", 'here=$(CDPATH= cd -- "$(dirname -- "$0")" && pwd -P)', *lines]
    run = 'exec "$here/venv/bin/python" -P -c \'from karma.cli import app; app(prog_name="karma")\''
    return "\n".join([*script, f'{run} "$@"', ""]).encode()


def _try_out(contents: Contents, programs: _Programs, smoke: bool) -> None:
    """Let the new installation check its models and, if it has our planner, do something."""
    karma, say = str(programs.into / "karma"), programs.say
    if contents.models:
        say(f"karma models verify {' '.join(contents.models)}")
        programs.run([karma, "models", "verify", *contents.models])
    if smoke and {"karma-nano", "karma-mini"} & set(contents.models):
        say('karma run "Open the fridge."')
        programs.run([karma, "run", "Open the fridge."])
    elif smoke:
        say("karma world list")
        programs.run([karma, "world", "list"])


def _remove(folder: Path) -> None:
    """Remove a folder, also while a killed installation's last process still writes into it."""
    until = time.monotonic() + PATIENCE_S
    while True:
        try:
            return shutil.rmtree(folder)
        except OSError as error:
            if error.errno != errno.ENOTEMPTY or time.monotonic() > until:
                raise
            time.sleep(0.05)


def _new(path: Path) -> BinaryIO:
    """Open a file that was not there; a link that somebody has put there is not followed."""
    path.unlink(missing_ok=True)
    return path.open("xb")


def _no_link(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_NOFOLLOW | os.O_CLOEXEC, 0o644)


def _write(path: Path, data: bytes, *, executable: bool = False) -> None:
    part = path.with_name(f".karma-{path.name.removeprefix('.karma-')}.new")
    with _new(part) as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    part.chmod(0o755 if executable else 0o644)
    part.replace(path)


def main(arguments: Sequence[str] | None = None) -> int:
    """Verify or install; 0 when done, 1 when refused or failed."""
    parser = argparse.ArgumentParser(description="Install KARMA Offline from a bundle.")
    parser.add_argument("bundle", type=Path)
    parser.add_argument("--into", type=Path, help="folder; without it, only verify")
    parser.add_argument("--sha256", default="", help="the bundle's, as it was built")
    parser.add_argument("--no-smoke", action="store_true", help="run nothing afterwards")
    given = parser.parse_args(arguments)

    def say(text: str) -> None:
        sys.stdout.write(text + "\n")
        sys.stdout.flush()

    try:
        if given.into is None:
            contents = verify(given.bundle, sha256=given.sha256, say=say)
            say(f"{given.bundle}: all {len(contents.members)} members are right")
        else:
            smoke = not given.no_smoke
            install(given.bundle, given.into, sha256=given.sha256, smoke=smoke, say=say)
    except BundleError as error:
        sys.stderr.write(f"error: {error}\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
