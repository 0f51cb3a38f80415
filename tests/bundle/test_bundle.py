"""Bundles: built twice the same, verified byte by byte, refused when anything is wrong with them.

Covered: determinism, the bill of materials, the whole tamper list, what the installer needs. The
installation itself is in test_bundle_install.py.
"""

import hashlib
import io
import subprocess
import sys
import tarfile
import zipfile
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from packaging.requirements import Requirement

from karma.bundle import build as building
from karma.bundle.build import BundleSpec, build
from karma.bundle.contents import (
    END,
    FORMAT,
    MANIFEST,
    BundleError,
    Member,
    header,
    manifest_bytes,
    padding,
    read_contents,
    unsafe,
)
from karma.bundle.install import here, install
from karma.bundle.verify import verify
from karma.bundle.wheels import find_wheels, read_lock
from karma.errors import FileError, KarmaError
from karma.infer.manifest.manifest import find_model
from karma.infer.manifest.manifest import verify as verify_model

LOREM = b"some words of a file\n" * 40


def sha(data):
    return hashlib.sha256(data).hexdigest()


def wheel_bytes(name="small", version="1.0", *, needs=(), extra=(), module=True):
    """A wheel of one module or none, with a licence."""
    info = f"{name}-{version}.dist-info"
    lines = ["Metadata-Version: 2.4", f"Name: {name}", f"Version: {version}"]
    lines += ["License-Expression: MIT", *(f"Requires-Dist: {need}" for need in needs)]
    files = {
        **({f"{name}.py": f"WORD = {name!r}\n"} if module else {}),
        **dict(extra),
        f"{info}/METADATA": "\n".join(lines) + "\n\n",
        f"{info}/WHEEL": "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        f"{info}/licenses/LICENSE": "Do what you like.\n",
    }
    record = "".join(f"{path},,\n" for path in [*files, f"{info}/RECORD"])
    sink = io.BytesIO()
    with zipfile.ZipFile(sink, "w", zipfile.ZIP_DEFLATED) as file:
        for path, text in {**files, f"{info}/RECORD": record}.items():
            file.writestr(zipfile.ZipInfo(path), text, compress_type=zipfile.ZIP_DEFLATED)
    return sink.getvalue()


def member(path, data, **given):
    return Member(path=path, bytes=len(data), sha256=sha(data), **given)


def pack(files, *, headers=None, about=None, rows=None):
    """A bundle by hand; `headers` replaces members' tar headers, `rows` the manifest's rows."""
    machine = dict(zip(("python", "platform"), here(), strict=True))
    said = {"karma": "0.1.0", "models": [], **machine, **(about or {})}
    rows = rows or [member(path, data) for path, data in files.items()]
    text = manifest_bytes(said, rows)
    parts = [header(MANIFEST, len(text)), text, bytes(padding(len(text)))]
    for path, data in files.items():
        parts.append((headers or {}).get(path) or header(path, len(data)))
        parts += [data, bytes(padding(len(data)))]
    return b"".join([*parts, END])


@pytest.fixture
def bundle(tmp_path):
    """A function that writes bytes as a bundle."""

    def write(data):
        path = tmp_path / "b.tar"
        path.write_bytes(data)
        return path

    return write


GOOD = {"eval/x.toml": b"x = 1\n", "models/nano/planner.gguf": LOREM, "sbom.json": b"{}\n"}


# ----------------------------------------------------------------- the archive


def test_bundle_is_a_tar_that_others_can_read(bundle):
    long = "licences/" + "deep/" * 30 + "LICENSE"
    path = bundle(pack({**GOOD, long: LOREM}))
    with tarfile.open(path, "r:") as file:
        assert file.getnames() == [MANIFEST, *GOOD, long]
        assert file.extractfile(long).read() == LOREM
    assert subprocess.run(["tar", "-tf", path], capture_output=True, check=True).stderr == b""


@pytest.mark.parametrize("size", [0, 8**11 - 1, 8**11, 5 << 40])
def test_header_of_any_size_is_read_back(size):
    info = tarfile.TarInfo.frombuf(header("models/big.gguf", size), "utf-8", "strict")
    assert (info.name, info.size, info.isreg()) == ("models/big.gguf", size, True)


def test_whole_bundle_is_accepted(bundle):
    found = verify(bundle(pack(GOOD)))
    assert [one.path for one in found.members] == list(GOOD)
    assert (found.python, found.platform) == here()


@given(st.data())
def test_one_flipped_bit_anywhere_is_refused_and_its_member_named(tmp_path_factory, data):
    whole = bytearray(pack(GOOD))
    place = data.draw(st.integers(0, len(whole) - 1))
    whole[place] ^= 1 << data.draw(st.integers(0, 7))
    path = tmp_path_factory.mktemp("flip") / "b.tar"
    path.write_bytes(whole)
    with pytest.raises(BundleError) as caught:
        verify(path)
    start = read_contents(io.BytesIO(pack(GOOD))).start
    expected = MANIFEST if place < start else "the bundle's end"
    offset = start
    for name, body in GOOD.items():
        end = offset + 512 + len(body) + padding(len(body))
        expected = name if offset <= place < end else expected
        offset = end
    assert expected in str(caught.value)


@given(st.data())
def test_truncated_bundle_is_refused_by_the_member_where_it_breaks_off(tmp_path_factory, data):
    whole = pack(GOOD)
    path = tmp_path_factory.mktemp("cut") / "b.tar"
    path.write_bytes(whole[: data.draw(st.integers(0, len(whole) - 1))])
    with pytest.raises(BundleError, match=r"breaks off|not a bundle|damaged|its end"):
        verify(path)


def test_bundle_with_something_behind_its_end_is_refused(bundle):
    with pytest.raises(BundleError, match="its end"):
        verify(bundle(pack(GOOD) + bytes(512)))


@pytest.mark.parametrize(
    "path",
    ["../evil", "/etc/passwd", "a/../../b", "models//x", "./x", "~/x", "C:x", "a\\b", "a\nb", ""],
)
def test_path_that_leads_elsewhere_is_refused_by_name(path, bundle):
    assert unsafe(path)
    whole = bundle(pack({"LICENSE": b"x", path: b"evil"}))
    with pytest.raises(BundleError, match="refused, its path") as caught:
        verify(whole)
    assert repr(path) in str(caught.value)


@pytest.mark.parametrize("path", ["venv/bin/python", "karma", ".karma-bundle", "KARMA/x"])
def test_path_of_the_installation_itself_is_refused(path, bundle):
    with pytest.raises(BundleError, match="belongs to the installation"):
        verify(bundle(pack({path: b"x"})))


@pytest.mark.parametrize(("one", "other"), [("a", "a"), ("A/b", "a/B"), ("a", "a/b"), ("a/b", "a")])
def test_paths_that_meet_are_refused(one, other, bundle):
    rows = [member(one, b"x"), member(other, b"x")]
    with pytest.raises(BundleError, match="twice"):
        verify(bundle(pack({one: b"x", other: b"x"}, rows=rows)))


LINKS = [(tarfile.SYMTYPE, "symbolic link"), (tarfile.LNKTYPE, "hard link")]
ODD = [(tarfile.CHRTYPE, "device"), (tarfile.FIFOTYPE, "pipe"), (tarfile.DIRTYPE, "folder")]


@pytest.mark.parametrize(("kind", "called"), [*LINKS, *ODD, (tarfile.GNUTYPE_SPARSE, "sparse")])
def test_member_that_is_no_plain_file_is_refused_by_kind(kind, called, bundle):
    info = tarfile.TarInfo("sbom.json")
    info.type, info.linkname = kind, "/etc/passwd"
    headers = {"sbom.json": info.tobuf(tarfile.USTAR_FORMAT)}
    with pytest.raises(BundleError, match=rf"sbom\.json: refused, it is .*{called}"):
        verify(bundle(pack(GOOD, headers=headers)))


def test_member_under_another_name_is_refused(bundle):
    headers = {"sbom.json": header("../../etc/x", len(GOOD["sbom.json"]))}
    with pytest.raises(BundleError, match=r"sbom\.json: refused, '../../etc/x' stands"):
        verify(bundle(pack(GOOD, headers=headers)))


def test_member_larger_than_the_manifest_says_is_refused(bundle):
    rows = [member(p, d) for p, d in GOOD.items()]
    whole = pack({**GOOD, "sbom.json": bytes(1 << 20)}, rows=rows)
    with pytest.raises(BundleError, match="instead of"):
        verify(bundle(whole))


def wheel_bundle(data, unpacked):
    path = "wheels/small-1.0-py3-none-any.whl"
    return pack({path: data}, rows=[member(path, data, unpacked=unpacked)])


def bomb():
    return wheel_bytes(extra={"small/zeros.bin": "0" * (30 << 20)}.items())


def test_wheel_that_unpacks_to_more_than_it_says_is_refused(bundle):
    with pytest.raises(BundleError, match=r"small-1\.0.*whl: refused, it unpacks to"):
        verify(bundle(wheel_bundle(bomb(), 100)))


def test_wheel_that_unpacks_to_absurdly_much_is_refused_also_if_it_says_so(bundle):
    data = bomb()
    with zipfile.ZipFile(io.BytesIO(data)) as wheel:
        total = sum(one.file_size for one in wheel.infolist())
    with pytest.raises(BundleError, match="times"):
        verify(bundle(wheel_bundle(data, total)))


def test_wheel_that_reaches_out_of_its_folder_is_refused(bundle):
    data = wheel_bytes(extra={"../../evil.py": "x"}.items())
    with zipfile.ZipFile(io.BytesIO(data)) as wheel:
        total = sum(one.file_size for one in wheel.infolist())
    with pytest.raises(BundleError, match="evil"):
        verify(bundle(wheel_bundle(data, total)))


def test_wheel_that_is_none_is_refused(bundle):
    with pytest.raises(BundleError, match="not a wheel"):
        verify(bundle(wheel_bundle(LOREM, 5)))


def test_bundle_of_another_version_is_refused_with_the_way_out(bundle):
    whole = pack(GOOD).replace(b"karma-bundle %d " % FORMAT, b"karma-bundle 9 ", 1)
    with pytest.raises(BundleError, match=r"version 9(.|\n)*install\.pyz"):
        verify(bundle(whole))


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
    verify(path, sha256=sha(path.read_bytes()))


@pytest.mark.parametrize("data", [b"", b"\0" * 1024, b"PK\3\4", LOREM * 9])
def test_what_is_no_bundle_is_refused(data, bundle):
    with pytest.raises(BundleError, match="not a bundle"):
        verify(bundle(data))


def test_missing_bundle_is_named(tmp_path):
    with pytest.raises(BundleError, match=r"nowhere\.tar: No such file"):
        verify(tmp_path / "nowhere.tar")


# ----------------------------------------------------------------- building


@pytest.fixture
def spec(tmp_path, monkeypatch):
    """Two small wheels, a lock of them, a wheel in the place of ours, and no models."""
    (tmp_path / "models" / "cards").mkdir(parents=True)
    (tmp_path / "models" / "manifest.toml").write_text("models = []\n")
    monkeypatch.setenv("KARMA_MODELS", str(tmp_path / "models"))
    folder = tmp_path / "wheels"
    folder.mkdir()
    for name in ("small", "other"):
        (folder / f"{name}-1.0-py3-none-any.whl").write_bytes(wheel_bytes(name))
    (tmp_path / "lock").write_text("# pins\nsmall==1.0\nother==1.0 ; sys_platform == 'linux'\n")
    own = tmp_path / "karma_offline-0.1.0-py3-none-any.whl"
    own.write_bytes(wheel_bytes("karma_offline", "0.1.0", needs=["small>=1"]))
    return BundleSpec(wheels=folder, lock=tmp_path / "lock", own=own)


def test_equal_inputs_give_equal_bytes(spec, tmp_path):
    one, other = (build(tmp_path / name, spec) for name in ("a.tar", "b.tar"))
    assert one.sha256 == other.sha256 == sha((tmp_path / "b.tar").read_bytes())
    assert verify(one.path).digest == verify(other.path).digest


def test_built_bundle_has_wheels_licences_and_installer(spec, tmp_path):
    paths = [one.path for one in verify(build(tmp_path / "a.tar", spec).path).members]
    assert "wheels/small-1.0-py3-none-any.whl" in paths
    assert "licences/small-1.0/LICENSE" in paths
    assert {"install.pyz", "eval/demo.toml", "models/manifest.toml"} <= set(paths)


def test_what_only_extras_need_comes_along_where_it_is_asked_for(spec, tmp_path):
    (spec.wheels / "extra-1.0-py3-none-any.whl").write_bytes(wheel_bytes("extra"))
    (tmp_path / "extras").write_text("extra==1.0\n")
    more = replace(spec, extras=tmp_path / "extras")
    with_, without = (
        {one.path for one in verify(build(tmp_path / name, one).path).members}
        for name, one in (("with.tar", more), ("without.tar", spec))
    )
    assert {p for p in with_ - without if p.startswith("wheels/")} == {
        "wheels/extra-1.0-py3-none-any.whl"
    }


def test_missing_wheels_are_named_with_the_way_out(spec, tmp_path):
    spec.lock.write_text("small==2.0\nabsent==1.0\n")
    with pytest.raises(BundleError, match=r"small==2\.0; absent==1\.0(.|\n)*--download"):
        build(tmp_path / "a.tar", spec)
    assert not (tmp_path / "a.tar").exists()


def test_wheel_of_a_local_version_fills_a_plain_pin(tmp_path):
    (tmp_path / "torch-2.13.0+cpu-py3-none-any.whl").write_bytes(wheel_bytes("torch", "2.13.0+cpu"))
    (found,) = find_wheels([Requirement("torch==2.13.0")], [tmp_path])
    assert found.version == "2.13.0+cpu"


def test_what_a_wheel_needs_comes_along_or_is_missed(tmp_path):
    (tmp_path / "a-1-py3-none-any.whl").write_bytes(wheel_bytes("a", "1", needs=["b>=2"]))
    with pytest.raises(BundleError, match=r"b>=2 \(needed by a\)"):
        find_wheels([Requirement("a==1")], [tmp_path])
    (tmp_path / "b-3-py3-none-any.whl").write_bytes(wheel_bytes("b", "3"))
    assert [one.name for one in find_wheels([Requirement("a==1")], [tmp_path])] == ["a", "b"]


def test_damaged_wheel_is_named(spec, tmp_path):
    (spec.wheels / "small-1.0-py3-none-any.whl").write_bytes(LOREM)
    with pytest.raises(FileError, match=r"small-1\.0"):
        build(tmp_path / "a.tar", spec)


def test_lock_with_a_line_that_is_none_is_named(tmp_path):
    (tmp_path / "lock").write_text("fine==1\nnot a pin at all\n")
    with pytest.raises(FileError, match="line 2"):
        read_lock(tmp_path / "lock")


def test_link_in_a_unity_build_is_refused(spec, tmp_path):
    (tmp_path / "unity").mkdir()
    (tmp_path / "unity" / "lib.so").symlink_to("/usr/lib/libc.so")
    given = replace(spec, thor=tmp_path / "unity")
    with pytest.raises(FileError, match="link"):
        build(tmp_path / "a.tar", given)


def test_scenes_come_along_and_damaged_ones_do_not(spec, tmp_path):
    from karma.world.core.scene import SCENES

    given = replace(spec, scenes=(SCENES / "kitchen_1.json",))
    paths = [one.path for one in verify(build(tmp_path / "a.tar", given).path).members]
    assert "scenes/kitchen_1.json" in paths
    (tmp_path / "torn.json").write_bytes((SCENES / "kitchen_1.json").read_bytes()[:900])
    given = replace(spec, scenes=(tmp_path / "torn.json",))
    with pytest.raises(KarmaError, match="torn"):
        build(tmp_path / "a.tar", given)


def test_installer_needs_the_standard_library_only(bundle, tmp_path):
    (tmp_path / "install.pyz").write_bytes(building.installer())
    path = bundle(pack(GOOD))
    command = [sys.executable, "-I", "-S", str(tmp_path / "install.pyz"), str(path)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert "all 3 members are right" in done.stdout
    path.write_bytes(pack(GOOD)[:-600])
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith("error: ")


def test_models_that_were_added_by_hand_travel_with_a_list_of_their_own(tmp_path, monkeypatch):
    import msgspec

    from karma.infer.manifest.manifest import Manifest, ModelEntry, ModelFile

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
    found = {one.path: one for one in building._model_sources([entry], set())}
    assert found["models/weights/big/big.gguf"].file == Path(place)
    (back,) = msgspec.toml.decode(found["models/local.toml"].data, type=Manifest).models
    assert back == msgspec.structs.replace(
        entry, files=(msgspec.structs.replace(entry.files[0], path="weights/big/big.gguf"),)
    )


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
    sources = building._model_sources([find_model("big", shipped)], packages)
    found = {one.path: one for one in sources}
    assert ("models/weights/big/big.gguf" in found) is not comes
    if comes:
        return
    for name in ("models/weights/big/big.gguf", "models/local.toml"):
        place = tmp_path / "there" / name
        place.parent.mkdir(parents=True, exist_ok=True)
        with found[name].open() as file:
            place.write_bytes(file.read())
    monkeypatch.undo()  # over there the package is not installed
    over_there = find_model("big", shipped)
    assert verify_model(over_there, shipped) == (shipped.parent / "weights/big/big.gguf",)
