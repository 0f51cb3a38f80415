"""Bundles that mean harm: damaged, with members out of the folder, or links where they go."""

import ensurepip
from functools import cache, partial
from pathlib import Path

import pytest
from support.abuse import all_held
from support.abuse.files import Kind, files
from support.bundles import pack

from karma.errors import KarmaError
from karma.plugins.airgap.install import BundleError, install, unsafe, verify


@cache
def bundle():
    """A bundle of one file for another platform."""
    about = {"karma": "1", "python": "3.11", "platform": "x", "models": []}
    return pack({"licences/x": b"a licence\n"}, about=about)


def verified(path):
    try:
        return verify(path)
    except BundleError as error:
        raise KarmaError(str(error)) from error


def test_hostile_bundles_are_refused_by_name_and_leave_nothing(tmp_path):
    kinds = [Kind(name="karma.tar", sound=bundle, read=verified)]
    all_held(partial(files, kinds=kinds), 28, tmp_path)


@pytest.mark.parametrize("name", ["../x", "/x", "a/../../x", "..", "a/../.."])
def test_name_of_a_member_never_leaves_the_folder(name):
    assert unsafe(name)


def small_bundle(folder):
    """A bundle of one wheel, pip, and some files."""
    sources = [*Path(ensurepip.__file__).parent.glob("_bundled/pip-*.whl")]
    parts = {f"wheels/{one.name}": one.read_bytes() for one in sources}
    parts |= {f"eval/{n}.toml": f"n = {n}\n".encode() * 20_000 for n in range(30)}
    path = folder / "karma.tar"
    path.write_bytes(pack(parts))
    return path


def test_link_planted_where_an_installation_writes_is_not_followed(tmp_path):
    archive = small_bundle(tmp_path)
    mine, into = tmp_path / "mine.txt", tmp_path / "into"
    mine.write_text("mine")
    into.mkdir()
    (into / ".karma-lock").symlink_to(mine)
    with pytest.raises(BundleError, match="symbolic link"):
        install(archive, into, smoke=False)
    (into / ".karma-lock").unlink()
    (into / ".karma-part").symlink_to(mine)
    install(archive, into, smoke=False)
    assert mine.read_text() == "mine"
    for planted, to in (("eval/1.toml", mine), ("eval", tmp_path)):
        (into / planted).rename(into / f".karma-was-{to.name}")
        (into / planted).symlink_to(to)
        with pytest.raises(BundleError, match="outside"):
            install(archive, into, smoke=False)
        assert mine.read_text() == "mine"
