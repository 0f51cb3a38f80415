#!/usr/bin/env bash
# Build llama.cpp's own server from the source in the pinned llama-cpp-python package; called by
# `make server`. An extra: nothing else needs it, and tests that do say so and skip without it.
#
# Prints where it is; does nothing where it is there and runs; with --where never builds. About 11 minutes on two cores, one
# file of 15 MB, pictures included. Asks the package index for the source, and nobody after that.
#
#   KARMA_CACHE=folder    where it is kept; default ~/.cache/karma, there bin/llama-server-VERSION
#   SOURCE=file.tar.gz    the package's source, where it is at hand; else pip downloads it
#   SERVER_CMAKE_ARGS     further options, e.g. "-DGGML_CUDA=on"; such a server is kept apart
#   JOBS=2                compilers at a time; default as many as cores
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
py=.venv/bin/python
version=$(sed -n 's/^llama-cpp-python==\([^ ;]*\).*/\1/p' requirements.lock)
extra=${SERVER_CMAKE_ARGS:-}
name=llama-server-$version
[ -z "$extra" ] || name+=-$(printf '%s' "$extra" | cksum | cut -d' ' -f1)
bin=${KARMA_CACHE:-${XDG_CACHE_HOME:-$HOME/.cache}/karma}/bin
server=$bin/$name
# no tests, examples or web page: the page would be fetched from the network
flags="-DCMAKE_BUILD_TYPE=Release -DBUILD_SHARED_LIBS=OFF -DGGML_NATIVE=OFF -DLLAMA_OPENSSL=OFF"
flags+=" -DLLAMA_BUILD_TESTS=OFF -DLLAMA_BUILD_EXAMPLES=OFF -DLLAMA_BUILD_APP=OFF"
flags+=" -DLLAMA_BUILD_UI=OFF -DLLAMA_USE_PREBUILT_UI=OFF"

say() { printf 'server: %s\n' "$*" >&2; }
die() { printf 'server: stopped. %s\n' "$*" >&2; exit 1; }

works() { [ -x "$server" ] && "$server" --version >/dev/null 2>&1; }

if works; then
    printf '%s\n' "$server"
    exit 0
fi
[ "${1:-}" != --where ] || die "it is not there: make server"
[ -x "$py" ] || die "there is no .venv; run make setup first"
command -v cmake >/dev/null || die "CMake is missing; see docs/hosted.md"
mkdir -p "$bin"
work=$(mktemp -d "$bin/.building.XXXXXX")
trap 'rm -rf "$work"' EXIT
log=$bin/$name.log

source=${SOURCE:-}
if [ -z "$source" ]; then
    say "fetching the source of llama-cpp-python $version"
    "$py" -m pip download --quiet --no-deps --no-build-isolation --no-binary llama-cpp-python \
        --dest "$work" "llama-cpp-python==$version" >"$log" 2>&1 || {
        tail -n 5 "$log" >&2
        die "pip has no source of it; give SOURCE=llama_cpp_python-$version.tar.gz"
    }
    source=$(echo "$work"/llama_cpp_python-"$version".tar.gz)
fi
tar -xzf "$source" -C "$work"
llama=$work/llama_cpp_python-$version/vendor/llama.cpp
[ -d "$llama" ] || die "$source holds no vendor/llama.cpp"

jobs=${JOBS:-$(getconf _NPROCESSORS_ONLN)}
generator=()
! command -v ninja >/dev/null || generator=(-G Ninja)
say "building with $jobs compilers at a time; the log is $log"
# shellcheck disable=SC2086 -- the flags are words
cmake -S "$llama" -B "$work/build" "${generator[@]}" $flags $extra >"$log" 2>&1 ||
    { tail -n 15 "$log" >&2; die "CMake failed"; }
began=$SECONDS
cmake --build "$work/build" --target llama-server -j "$jobs" >>"$log" 2>&1 &
build=$!
trap 'kill "$build" 2>/dev/null || true; rm -rf "$work"' EXIT
while kill -0 "$build" 2>/dev/null; do
    for _ in 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15; do
        kill -0 "$build" 2>/dev/null || break
        sleep 2
    done
    say "  ... $((SECONDS - began)) s, $(grep -oE '^\[ *[0-9]+[%/0-9]*\]' "$log" | tail -n 1)"
done
wait "$build" || { tail -n 15 "$log" >&2; die "the build failed"; }
mv -f "$work/build/bin/llama-server" "$server"
works || die "$server was built, but does not run"
say "ready after $((SECONDS - began)) s"
printf '%s\n' "$server"
