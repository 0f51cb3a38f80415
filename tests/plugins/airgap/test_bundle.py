"""Bundles: built twice the same, verified file by file, refused when anything is wrong with them.

Covered: determinism, what comes along, the tamper list, what the installer needs. The installation
itself is in test_bundle_install.py.
"""

import hashlib
import io
import os
import shutil
import subprocess
import sys
import tarfile
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.bundles import pack, wheel_bytes

from karma.errors import FileError, KarmaError
from karma.files import cache
from karma.models.manifest import find_model
from karma.models.manifest import verify as verify_model
from karma.plugins.airgap import build as building
from karma.plugins.airgap import install as installing
from karma.plugins.airgap.build import BundleSpec, build
from karma.plugins.airgap.install import BundleError, install, unsafe, verify

LOREM = b"some words of a file\n" * 40


def sha(data):
    return hashlib.sha256(data).hexdigest()


@pytest.fixture
def bundle(tmp_path):
    """A function that writes bytes as a bundle."""

    def write(data):
        path = tmp_path / "b.tar"
        path.write_bytes(data)
        return path

    return write


GOOD = {"eval/x.toml": b"x = 1\n", "models/nano/planner.gguf": LOREM, "licences/a": b"mine\n"}


# ----------------------------------------------------------------- the archive


def test_whole_bundle_is_accepted_and_others_can_read_it(bundle, tmp_path):
    long = "licences/" + "deep/" * 30 + "LICENSE"
    path = bundle(pack({**GOOD, long: LOREM}))
    assert verify(path)["python"] == installing.here()[0]
    subprocess.run(["tar", "-xf", path], cwd=tmp_path, check=True)
    subprocess.run(["sha256sum", "--quiet", "-c", "SHA256SUMS"], cwd=tmp_path, check=True)
    assert (tmp_path / long).read_bytes() == LOREM


@given(st.data())
def test_one_flipped_bit_is_refused_or_changes_no_file(tmp_path_factory, data):
    """Time, owner and padding carry nothing: a bit there leaves every file as it was."""
    sound = pack(GOOD)
    whole = bytearray(sound)
    whole[data.draw(st.integers(0, len(whole) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    path = tmp_path_factory.mktemp("flip") / "b.tar"
    path.write_bytes(whole)
    try:
        verify(path)
    except BundleError:
        return
    with tarfile.open(path) as file, tarfile.open(fileobj=io.BytesIO(sound)) as right:
        for one, other in zip(file, right, strict=True):
            assert (one.name, one.type, one.size) == (other.name, other.type, other.size)
            assert file.extractfile(one).read() == right.extractfile(other).read()


@pytest.mark.parametrize("name", GOOD)
def test_damaged_file_is_named(name, bundle):
    data = pack(GOOD)
    place = data.index(GOOD[name])
    with pytest.raises(BundleError, match=f"{name}: its SHA-256"):
        verify(bundle(data[:place] + b"?" + data[place + 1 :]))


@given(st.data())
def test_truncated_bundle_is_refused(tmp_path_factory, data):
    whole = pack(GOOD)
    end = whole.rindex(sha(LOREM).encode())  # in SHA256SUMS, the last member
    path = tmp_path_factory.mktemp("cut") / "b.tar"
    path.write_bytes(whole[: data.draw(st.integers(0, end))])
    with pytest.raises(BundleError):
        verify(path)


ELSEWHERE = ["../evil", "/etc/passwd", "eval/../../b", "models//x", "./x", "~/x", "C:x", "eval\\b"]
OURS = ["eval/\nb", "venv/bin/python", "karma", ".karma-bundle", "KARMA/x", "eval"]


@pytest.mark.parametrize("path", [*ELSEWHERE, *OURS])
def test_path_that_leads_elsewhere_or_is_the_installations_own_is_refused(path, bundle):
    assert unsafe(path)
    with pytest.raises(BundleError, match="refused, its path") as caught:
        verify(bundle(pack({**GOOD, path: b"evil"})))
    assert repr(path) in str(caught.value)


def test_path_that_stands_there_twice_is_refused(bundle):
    with pytest.raises(BundleError, match="refused, its path"):
        verify(bundle(pack([*GOOD.items(), ("eval/x.toml", b"y")])))


LINKS = [tarfile.SYMTYPE, tarfile.LNKTYPE]
ODD = [tarfile.CHRTYPE, tarfile.FIFOTYPE, tarfile.DIRTYPE, tarfile.GNUTYPE_SPARSE]


@pytest.mark.parametrize("kind", [*LINKS, *ODD])
def test_member_that_is_no_plain_file_is_refused(kind, bundle):
    info = tarfile.TarInfo("eval/odd")
    info.type, info.linkname = kind, "/etc/passwd"
    with pytest.raises(BundleError, match="eval/odd: "):
        verify(bundle(pack(GOOD, more=[info])))


@pytest.mark.parametrize(("name", "said"), [("eval/x.toml", "missing"), ("eval/y.toml", "SHA-256")])
def test_file_that_is_missing_or_not_listed_is_named(name, said, bundle):
    files = dict(GOOD) if said == "missing" else {**GOOD, name: b"more"}
    sums = {path: sha(data) for path, data in GOOD.items()}
    if said == "missing":
        del files[name]
    with pytest.raises(BundleError, match=f"{name}: .*{said}"):
        verify(bundle(pack(files, sums=sums)))


@pytest.mark.parametrize(("key", "value"), [("python", "3.2"), ("platform", "win32-AMD64")])
def test_bundle_for_another_machine_is_not_installed(key, value, bundle, tmp_path):
    path = bundle(pack(GOOD, about={key: value}))
    with pytest.raises(BundleError, match="the bundle is for"):
        install(path, tmp_path / "there")
    assert not (tmp_path / "there").exists()


def test_forged_bundle_is_refused_by_the_hash_from_elsewhere(bundle):
    path = bundle(pack(GOOD))
    with pytest.raises(BundleError, match="its SHA-256 is"):
        verify(path, sha256="0" * 64)
    verify(path, sha256=sha(path.read_bytes()).upper())


@pytest.mark.parametrize("data", [b"", b"\0" * 1024, b"PK\3\4", LOREM * 9])
def test_what_is_no_bundle_is_refused(data, bundle):
    with pytest.raises(BundleError, match="its begin: damaged"):
        verify(bundle(data))


def test_missing_bundle_is_named(tmp_path):
    with pytest.raises(BundleError, match=r"nowhere\.tar: no such file"):
        verify(tmp_path / "nowhere.tar")


# ----------------------------------------------------------------- building


def test_bundle_takes_the_wheel_that_setup_installed(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    assert building.kept_wheels() == cache() / "wheels"
    (tmp_path / building.BUILT).write_text(f"pins\n-DGGML_CUDA=on\n{tmp_path / 'kept'}\n")
    assert building.kept_wheels() == tmp_path / "kept"


@pytest.fixture
def spec(tmp_path, monkeypatch):
    """Two small wheels, a lock of them, a wheel in the place of ours, and no models."""
    (tmp_path / "models" / "cards").mkdir(parents=True)
    (tmp_path / "models" / "manifest.toml").write_text("models = []\n")
    monkeypatch.setenv("KARMA_MODELS", str(tmp_path / "models"))
    monkeypatch.setenv("KARMA_CACHE", str(tmp_path))
    monkeypatch.setattr("karma.plugins.airgap.build.BUILT", "no note")
    monkeypatch.setenv("PIP_CONFIG_FILE", os.devnull)  # this and the next may name others
    monkeypatch.delenv("PIP_FIND_LINKS", raising=False)
    folder = tmp_path / "wheels"
    folder.mkdir()
    for name in ("small", "other"):
        (folder / f"{name}-1.0-py3-none-any.whl").write_bytes(wheel_bytes(name))
    (tmp_path / "lock").write_text("# pins\nsmall==1.0\nother==1.0 ; sys_platform == 'linux'\n")
    own = tmp_path / "karma_offline-0.1.0-py3-none-any.whl"
    own.write_bytes(wheel_bytes("karma_offline", "0.1.0", needs=["small>=1"]))
    return BundleSpec(wheels=folder, lock=tmp_path / "lock", own=own)


def listed(built):
    verify(built.path, sha256=built.sha256)
    with tarfile.open(built.path) as file:
        return file.getnames()


def test_equal_inputs_give_equal_bytes(spec, tmp_path):
    one, other = (build(tmp_path / name, spec) for name in ("a.tar", "b.tar"))
    assert one.sha256 == other.sha256 == sha((tmp_path / "b.tar").read_bytes())


def test_built_bundle_has_wheels_licences_and_installer(spec, tmp_path):
    paths = listed(build(tmp_path / "a.tar", spec))
    assert "wheels/small-1.0-py3-none-any.whl" in paths
    assert "licences/small-1.0/LICENSE" in paths
    assert {"install.py", "eval/demo.toml", "models/manifest.toml"} <= set(paths)


def test_what_only_extras_need_comes_along_where_it_is_asked_for(spec, tmp_path):
    (spec.wheels / "extra-1.0-py3-none-any.whl").write_bytes(wheel_bytes("extra"))
    (tmp_path / "extras").write_text("extra==1.0\n")
    more = replace(spec, extras=tmp_path / "extras")
    with_, without = (
        set(listed(build(tmp_path / name, one)))
        for name, one in (("with.tar", more), ("without.tar", spec))
    )
    assert {p for p in with_ - without if p.startswith("wheels/")} == {
        "wheels/extra-1.0-py3-none-any.whl"
    }


def test_missing_wheel_is_named_with_the_way_out(spec, tmp_path):
    spec.lock.write_text("small==2.0\n")
    with pytest.raises(KarmaError, match=r"small==2\.0(.|\n)*--download"):
        build(tmp_path / "a.tar", spec)
    assert not (tmp_path / "a.tar").exists()


def test_wheel_of_a_local_version_fills_a_plain_pin(spec, tmp_path):
    (spec.wheels / "torch-2.13.0+cpu-py3-none-any.whl").write_bytes(
        wheel_bytes("torch", "2.13.0+cpu")
    )
    spec.lock.write_text("torch==2.13.0\n")
    assert "wheels/torch-2.13.0+cpu-py3-none-any.whl" in listed(build(tmp_path / "a.tar", spec))


def test_what_a_wheel_needs_comes_along_or_is_missed(spec, tmp_path):
    (spec.wheels / "a-1-py3-none-any.whl").write_bytes(wheel_bytes("a", "1", needs=["b>=2"]))
    spec.lock.write_text("a==1\n")
    with pytest.raises(KarmaError, match="b>=2"):
        build(tmp_path / "a.tar", spec)
    (spec.wheels / "b-3-py3-none-any.whl").write_bytes(wheel_bytes("b", "3"))
    assert "wheels/b-3-py3-none-any.whl" in listed(build(tmp_path / "a.tar", spec))


def test_damaged_wheel_is_named(spec, tmp_path):
    (spec.wheels / "small-1.0-py3-none-any.whl").write_bytes(LOREM)
    with pytest.raises(FileError, match=r"small-1\.0"):
        build(tmp_path / "a.tar", spec)


def test_lock_with_a_line_that_is_none_is_named(spec, tmp_path):
    spec.lock.write_text("small==1.0\nnot a pin at all\n")
    with pytest.raises(KarmaError, match="line 2"):
        build(tmp_path / "a.tar", spec)


def test_link_in_a_unity_build_is_refused(spec, tmp_path):
    (tmp_path / "unity").mkdir()
    (tmp_path / "unity" / "lib.so").symlink_to("/usr/lib/libc.so")
    given = replace(spec, thor=tmp_path / "unity")
    with pytest.raises(FileError, match="link"):
        build(tmp_path / "a.tar", given)


def test_scenes_come_along_and_damaged_ones_do_not(spec, tmp_path):
    from karma.world.core.scene import SCENES

    given = replace(spec, scenes=(SCENES / "kitchen_1.json",))
    paths = listed(build(tmp_path / "a.tar", given))
    assert "scenes/kitchen_1.json" in paths
    (tmp_path / "torn.json").write_bytes((SCENES / "kitchen_1.json").read_bytes()[:900])
    given = replace(spec, scenes=(tmp_path / "torn.json",))
    with pytest.raises(KarmaError, match="torn"):
        build(tmp_path / "a.tar", given)


def test_installer_needs_the_standard_library_only(bundle, tmp_path):
    script = shutil.copy(installing.__file__, tmp_path)
    path = bundle(pack(GOOD))
    command = [sys.executable, "-I", "-S", script, str(path)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert "every file is right" in done.stdout
    path.write_bytes(pack(GOOD)[:600])
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith("error: ")


def test_models_that_were_added_by_hand_travel_with_a_list_of_their_own(tmp_path, monkeypatch):
    import msgspec

    from karma.models.manifest import Manifest, ModelEntry, ModelFile

    place = tmp_path / "elsewhere" / "big.gguf"
    place.parent.mkdir()
    place.write_bytes(LOREM)
    entry = ModelEntry(
        name="big",
        role="planner",
        format="gguf",
        licence='MIT "as is"',
        source="us",
        prompt_profile="full",
        context_length=99,
        files=(ModelFile(path=str(place), sha256=sha(LOREM), bytes=len(LOREM)),),
    )
    found = dict(building._model_sources([entry], set()))
    assert found["models/weights/big/big.gguf"] == place
    (back,) = msgspec.toml.decode(found["models/local.toml"], type=Manifest).models
    assert back == msgspec.structs.replace(
        entry, files=(msgspec.structs.replace(entry.files[0], path="weights/big/big.gguf"),)
    )


def test_models_that_share_a_file_travel_with_it_once(spec, tmp_path):
    (tmp_path / "models" / "words.json").write_bytes(LOREM)
    file = f'files = [{{ path = "words.json", bytes = {len(LOREM)}, sha256 = "{sha(LOREM)}" }}]\n'
    about = 'role = "planner"\nformat = "gguf"\nlicence = "MIT"\nsource = "us"\n'
    about += 'prompt_profile = "full"\ncontext_length = 99\n'
    both = "".join(f'[[models]]\nname = "{name}"\n{about}{file}' for name in ("one", "two"))
    (tmp_path / "models" / "manifest.toml").write_text(both)
    assert listed(build(tmp_path / "a.tar", spec)).count("models/words.json") == 1


@pytest.mark.parametrize("comes", [True, False])
def test_model_in_a_package_travels_by_its_wheel_or_else_by_its_files(comes, tmp_path, monkeypatch):
    (tmp_path / "some_weights").mkdir()
    (tmp_path / "some_weights" / "big.gguf").write_bytes(LOREM)
    monkeypatch.syspath_prepend(tmp_path)
    shipped = tmp_path / "there" / "models" / "manifest.toml"
    shipped.parent.mkdir(parents=True)
    shipped.write_text(
        '[[models]]\nname = "big"\nrole = "planner"\nformat = "gguf"\npackage = "some_weights"\n'
        'licence = "MIT"\nsource = "us"\nprompt_profile = "full"\ncontext_length = 99\n'
        f'files = [{{ path = "big.gguf", bytes = {len(LOREM)}, sha256 = "{sha(LOREM)}" }}]\n'
    )
    packages = {"some-weights"} if comes else set()
    with monkeypatch.context() as there:
        there.setenv("KARMA_MODELS", str(shipped.parent))
        entry = find_model("big")
    found = dict(building._model_sources([entry], packages))
    assert ("models/weights/big/big.gguf" in found) is not comes
    if comes:
        return
    for name in ("models/weights/big/big.gguf", "models/local.toml"):
        place = tmp_path / "there" / name
        place.parent.mkdir(parents=True, exist_ok=True)
        data = found[name]
        place.write_bytes(data if isinstance(data, bytes) else data.read_bytes())
    monkeypatch.undo()  # over there the package is not installed
    monkeypatch.setenv("KARMA_MODELS", str(shipped.parent))
    over_there = find_model("big")
    assert verify_model(over_there) == (shipped.parent / "weights/big/big.gguf",)
