"""Verify a bundle and install it where there is no network and nothing but Python.

    tar -xOf karma.tar install.py > install.py
    python3.11 install.py karma.tar --into /opt/karma

This file travels in each bundle and runs there alone, so: standard library only.

SHA256SUMS finds damage. Against a bundle that somebody has forged only the SHA-256 helps that
`karma bundle build` prints, brought by another way.
"""

import argparse
import fcntl
import hashlib
import json
import os
import platform
import shutil
import signal
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

ABOUT, SUMS, INSTALLER = "bundle.json", "SHA256SUMS", "install.py"  # first, last, this file
FILES = (ABOUT, SUMS, INSTALLER, "LICENSE", "AIRGAP.md")
FOLDERS = ("wheels", "models", "eval", "scenes", "thor", "licences")
STAMP = ".karma-bundle"  # in the folder: which bundle is being installed there
SPARE_BYTES = 64 << 20
_DAMAGE = (tarfile.TarError, zipfile.BadZipFile, OSError, EOFError, ValueError, KeyError, TypeError)


class BundleError(Exception):
    """A bundle that is refused, or a step that failed; names the file or the step."""


def here() -> tuple[str, str]:
    """Return this machine's Python and platform, such as ("3.11", "linux-x86_64")."""
    major, minor = sys.version_info[:2]
    return f"{major}.{minor}", f"{sys.platform}-{platform.machine()}"


def unsafe(path: str) -> bool:
    """Return whether a path leads elsewhere or has no business in a bundle.

    >>> unsafe("models/nano/planner.gguf"), unsafe("models/../../x"), unsafe("venv/bin/python")
    (False, True, True)
    """
    parts = path.split("/")
    odd = not path.isprintable() or "\\" in path or {"", ".", ".."} & set(parts)
    return bool(odd) or (path not in FILES and (len(parts) < 2 or parts[0] not in FOLDERS))


def verify(bundle: Path, *, sha256: str = "") -> dict[str, Any]:
    """Check every file of a bundle without unpacking any; return what its bundle.json says.

    Raises:
        BundleError: something is not as it must be; names the file.
    """
    try:
        return _verified(bundle, sha256)
    except BundleError as error:
        fix = "copy the bundle again, or build it anew: karma bundle build"
        raise BundleError(f"{bundle}: {error}\n  To fix: {fix}") from error


def _verified(bundle: Path, sha256: str) -> dict[str, Any]:
    if not bundle.is_file():
        raise BundleError("no such file")
    name, found = "its begin", dict[str, str]()
    try:
        with bundle.open("rb") as file:
            whole = hashlib.file_digest(file, "sha256").hexdigest() if sha256 else ""
        if whole != sha256.lower():
            raise BundleError(f"its SHA-256 is {whole} and not {sha256.lower()}")
        with tarfile.open(bundle, "r:") as tar:
            for member in tar:
                name = member.name
                if name in found or unsafe(name):
                    raise BundleError(f"{name!r}: refused, its path is not for a bundle")
                if member.type not in (tarfile.REGTYPE, tarfile.AREGTYPE) or member.issparse():
                    raise BundleError(f"{name}: refused, it is a link, or no plain file")
                digest = hashlib.sha256()
                with _open(tar, name) as data:
                    while part := data.read(1 << 20):
                        digest.update(part)
                found[name] = digest.hexdigest()
            about = {"python": "", "platform": "", "models": [], **json.load(_open(tar, ABOUT))}
            lines = _open(tar, SUMS).read().decode().splitlines()
        wanted = {line[66:]: line[:64] for line in lines}
    except _DAMAGE as error:
        said = f"damaged, or the bundle breaks off there: {error}"
        raise BundleError(f"at or behind {name}: {said}") from error
    del found[SUMS]
    for path in sorted(wanted.keys() | found.keys()):
        if wanted.get(path) != found.get(path):
            said = "its SHA-256 is not the one in SHA256SUMS" if path in found else "missing"
            raise BundleError(f"{path}: {said}")
    return about


def _open(tar: tarfile.TarFile, name: str) -> IO[bytes]:
    """Open a member for reading; KeyError where it is not."""
    file = tar.extractfile(name)
    if file is None:
        raise KeyError(name)
    return file


def install(bundle: Path, into: Path, *, sha256: str = "", smoke: bool = True) -> None:
    """Verify a bundle, then install it; killed at any time, the same call does it again.

    The folder is new, empty, or where this bundle was being installed. The SHA-256 of the whole
    file is known from elsewhere, "" where not. With `smoke` it carries out one instruction.

    Raises:
        BundleError: refused, or a step failed; `into` then has no `karma` to run.
    """
    print(f"verifying {bundle}", flush=True)
    about = verify(bundle, sha256=sha256)
    for key, found in zip(("python", "platform"), here(), strict=True):
        if about[key] != found:
            raise BundleError(f"the bundle is for {key} {about[key]}, and this is {key} {found}")
    if not hasattr(tarfile, "data_filter"):
        raise BundleError("Python 3.11.4 or a later one is needed")
    launcher = into / "karma"
    try:
        into.mkdir(parents=True, exist_ok=True)
        with _alone(into), tarfile.open(bundle, "r:") as tar:
            _claim(into, tar)
            launcher.unlink(missing_ok=True)
            _check_room(into, tar)
            print(f"unpacking {len(tar.getnames())} files", flush=True)
            tar.extractall(into, filter="data")
            _make_venv(into)
            _write_launcher(launcher)
            try:
                _try_out(launcher, about["models"], smoke)
            except BundleError:
                launcher.unlink()
                raise
    except (OSError, tarfile.TarError) as error:
        raise BundleError(f"{into}: {error}\n  To fix: run the same command again") from error
    print(f"ready: {launcher} --help", flush=True)


@contextmanager
def _alone(into: Path) -> Iterator[None]:
    """Keep a second installation out; the kernel lets go when this process is dead."""
    flags = os.O_WRONLY | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC
    with os.fdopen(os.open(into / ".karma-lock", flags, 0o644), "wb") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise BundleError(f"{into}: another installation is at work there") from None
        yield


def _claim(into: Path, tar: tarfile.TarFile) -> None:
    """Refuse a folder that holds anything but this bundle's own beginnings."""
    digest, stamp = hashlib.sha256(_open(tar, SUMS).read()).hexdigest(), into / STAMP
    if stamp.exists():
        if stamp.read_text() != digest:
            raise BundleError(
                f"{into}: another bundle is installed there\n  To fix: choose another folder"
            )
    elif others := sorted(one.name for one in into.iterdir() if not one.name.startswith(".karma-")):
        raise BundleError(f"{into}: not empty, there is {others[0]!r}\n  To fix: another folder")
    _write(stamp, digest, 0o644)


def _check_room(into: Path, tar: tarfile.TarFile) -> None:
    """Refuse to begin where files, and packages with their bytecode, find no room."""
    wanted = SPARE_BYTES
    for member in tar:
        wanted += 0 if (into / member.name).exists() else member.size
        if member.name.endswith(".whl") and not (into / "venv").exists():
            with zipfile.ZipFile(_open(tar, member.name)) as wheel:
                wanted += int(1.3 * sum(entry.file_size for entry in wheel.infolist()))
    free = shutil.disk_usage(into).free
    if free < wanted:
        raise BundleError(f"{into}: {wanted >> 20} MiB are needed and {free >> 20} MiB are free")


def _make_venv(into: Path) -> None:
    """Make the virtual environment anew, from the wheels alone."""
    venv, wheels = into / "venv", sorted((into / "wheels").glob("*.whl"))
    if venv.exists():
        shutil.rmtree(venv)
    pip = next((one for one in wheels if one.name.startswith("pip-")), None)
    print(
        f"making a virtual environment with {len(wheels)} packages; this takes a while", flush=True
    )
    base = getattr(sys, "_base_executable", sys.executable)
    _run(base, "-I", "-m", "venv", *(["--without-pip"] if pip else []), str(venv))
    program = [str(venv / "bin" / "python"), *([str(pip / "pip")] if pip else ["-m", "pip"])]
    options = ("--no-index", "--no-deps", "--no-cache-dir", "--no-input", "--progress-bar", "off")
    _run(*program, "install", *options, *map(str, wheels))
    _run(*program, "check")


def _write_launcher(path: Path) -> None:
    """Write the shell script that runs karma in its environment, wherever the folder lies."""
    named = [("KARMA_MODELS", "models"), ("KARMA_SCENES", "scenes"), ("KARMA_THOR_BUILD", "thor")]
    there = [(key, top) for key, top in named if (path.parent / top).is_dir()]
    lines = [f': "${{{key}:=$here/{top}}}"; export {key}' for key, top in there]
    script = ["#!/bin/sh", 'here=$(CDPATH= cd -- "$(dirname -- "$0")" && pwd -P)', *lines]
    run = 'exec "$here/venv/bin/python" -P -c \'from karma.cli import app; app(prog_name="karma")\''
    _write(path, "\n".join([*script, f'{run} "$@"', ""]), 0o755)


def _write(path: Path, text: str, mode: int) -> None:
    """Write a file, whole or not at all; a link that somebody has put there is not followed."""
    part = path.with_name(".karma-part")
    part.unlink(missing_ok=True)
    with part.open("x") as file:
        file.write(text)
    part.chmod(mode)
    part.replace(path)


def _try_out(karma: Path, models: list[str], smoke: bool) -> None:
    """Let the new installation check its models and, if it has our planner, do something."""
    if models:
        _run(str(karma), "models", "verify", *models)
    if smoke and {"karma-nano", "karma-mini"} & set(models):
        _run(str(karma), "run", "Open the fridge.")
    elif smoke:
        _run(str(karma), "world", "list")


def _run(*command: str) -> None:
    """Run a program that prints for itself, without the network's and the caller's settings."""
    environment = {
        key: value
        for key, value in os.environ.items()
        if not key.startswith(("PIP_", "KARMA_")) and key not in ("PYTHONPATH", "PYTHONHOME")
    }
    environment |= {"PIP_CONFIG_FILE": os.devnull, "PIP_DISABLE_PIP_VERSION_CHECK": "1"}
    print("$", *(Path(word).name for word in command[:6]), flush=True)
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            command,
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            preexec_fn=_die_together,
            check=False,
        )
    if done.returncode != 0:
        raise BundleError(f"`{' '.join(command[:4])} ...` failed (exit code {done.returncode})")


def _die_together() -> None:
    """Let a child die with this process, where the system can do that."""
    if sys.platform.startswith("linux"):
        import ctypes

        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG


def main(arguments: list[str] | None = None) -> int:
    """Verify or install; 0 when done, 1 when refused or failed."""
    parser = argparse.ArgumentParser(description="Install KARMA Offline from a bundle.")
    parser.add_argument("bundle", type=Path)
    parser.add_argument("--into", type=Path, help="folder; without it, only verify")
    parser.add_argument("--sha256", default="", help="the bundle's, as it was built")
    parser.add_argument("--no-smoke", action="store_true", help="run nothing afterwards")
    given = parser.parse_args(arguments)
    try:
        if given.into is None:
            about = verify(given.bundle, sha256=given.sha256)
            python, machine, models = about["python"], about["platform"], about["models"]
            print(
                f"{given.bundle}: every file is right: Python {python}, {machine},",
                f"models {', '.join(models) or 'none'}",
            )
        else:
            smoke = not given.no_smoke
            install(given.bundle, given.into.absolute(), sha256=given.sha256, smoke=smoke)
    except BundleError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
