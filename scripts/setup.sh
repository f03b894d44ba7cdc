#!/usr/bin/env bash
# Sets up what is missing, and nothing twice: a virtual environment in the checkout, the pinned packages, the package
# itself, and the system's GL libraries. It is called by every make target and is silent when nothing is missing.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

venv=.venv
python=$venv/bin/python
log=$venv/setup.log
stamp=$venv/setup.stamp

say() { echo "set-up: $*"; }
fail() { echo "set-up: $*" >&2; exit 1; }

# The build of torch, as uv names it (UV_TORCH_BACKEND=cpu, cu128, ...), or that of the last set-up; none: chosen below.
torch_backend=${UV_TORCH_BACKEND:-$(cat "$venv/torch-backend" 2>/dev/null || true)}
unset UV_TORCH_BACKEND
asked_backend=$torch_backend

has_nvidia() { command -v nvidia-smi >/dev/null || [ -e /proc/driver/nvidia/version ]; }

# What the environment was made from. The path counts too: scripts and the editable install name it. So do the
# compiler and a GPU, which the build of torch is chosen by.
state() {
    {
        cat requirements.txt pyproject.toml scripts/setup.sh native/*
        pwd
        "${CXX:-c++}" --version 2>/dev/null || true
        printf '%s' "$asked_backend" "$(has_nvidia && echo nvidia)"
    } | sha256sum | cut -d ' ' -f 1
}

# Prints the newest Python on the path that the project is tested with, else another from 3.11 on, if it can import the
# modules given; ANM_MJ_PYTHON names another, which pyenv may have though it is not on the path.
find_python() {
    local name
    for name in ${ANM_MJ_PYTHON:-python3.13 python3.12 python3.11 python3 python3.14} \
        ${ANM_MJ_PYTHON:+"${PYENV_ROOT:-${HOME:-}/.pyenv}"/versions/"${ANM_MJ_PYTHON#python}"*/bin/python}; do
        if "$name" -c "import sys$1; sys.exit(sys.version_info < (3, 11))" 2>/dev/null; then echo "$name"; return; fi
    done
    return 1
}

# Runs apt-get as root, if there is a way to become it.
apt_get() {
    command -v apt-get >/dev/null || return 1
    local become=()
    if [ "$(id -u)" -ne 0 ]; then
        command -v sudo >/dev/null || return 1
        become=(sudo)
        [ -t 0 ] || become+=(--non-interactive)
    fi
    "${become[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -qq -o=Dpkg::Use-Pty=0 "$@" >>"${apt_log:-/dev/null}" 2>&1
}

apt_install() {
    say "installing system packages: $*"
    apt_get install --yes --no-install-recommends "$@" && return
    apt_get update && apt_get install --yes --no-install-recommends "$@"
}

# Whether the environment has the Python that ANM_MJ_PYTHON names.
is_wanted() {
    local wanted
    [ -n "${ANM_MJ_PYTHON:-}" ] || return 0
    wanted=$(find_python "") || return
    [ "$("$wanted" -c 'import sys; print(sys.version_info[:2])')" = "$("$python" -c 'import sys; print(sys.version_info[:2])')" ]
}

make_venv() {
    local base version
    base=$(find_python ", ensurepip, venv") || {
        base=$(find_python "") ||
            fail "${ANM_MJ_PYTHON:-Python 3.11 or newer} is needed, but $(python3 --version 2>/dev/null || echo "no Python") was found; install that and call again."
        # Debian and Ubuntu ship Python without what makes a virtual environment.
        version=$("$base" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
        apt_install "python$version-venv" && base=$(find_python ", ensurepip, venv") ||
            fail "Python $version cannot make a virtual environment here; run: apt install python$version-venv"
    }
    say "virtual environment $venv with $("$base" --version)"
    rm -rf "$venv"
    "$base" -m venv "$venv"
}

# uv reads no pip configuration, so what a company's network needs is handed on to it.
export_pip_settings() {
    local settings pair value
    settings=$("$python" -m pip config list 2>/dev/null || true)
    for pair in index-url=UV_DEFAULT_INDEX extra-index-url=UV_INDEX cert=SSL_CERT_FILE proxy=ALL_PROXY; do
        value=$(sed -n "s/^[^=]*\.${pair%%=*}='\(.*\)'\$/\1/p" <<<"$settings" | tail -n 1)
        [ -z "$value" ] || export "${pair#*=}=${value//\\n/ }"
    done
    # As pip does: the best version from any index.
    export UV_INDEX_STRATEGY=unsafe-best-match
}

# Installs uv, and chooses the build of torch where nobody has: that for CPUs where there is no NVIDIA GPU and its index,
# which is another one, can be reached; else the one on the package index, with CUDA.
prepare_uv() {
    local pins=$venv/uv.txt
    awk '/^[^ #]/ { uv = /^uv==/ } uv' requirements.txt >"$pins"
    "$python" -m pip install --quiet --no-deps --require-hashes --requirement "$pins" || return
    export_pip_settings
    [ -z "$torch_backend" ] && ! has_nvidia || return 0
    UV_HTTP_RETRIES=0 UV_HTTP_TIMEOUT=10 "$python" -m uv pip install --quiet --dry-run --python "$python" --no-deps \
        --torch-backend cpu "$(grep -o '^torch==[^ ]*' requirements.txt)" && torch_backend=cpu || true
}

# The build of torch that was chosen, and then all other pins. The pinned hashes are those of the usual build, so this
# one is taken by its version. That for CPUs needs none of the CUDA packages that are pinned.
install_with_backend() {
    [ -n "$torch_backend" ] || return
    local pins=$venv/requirements.txt others='torch=='
    [ "$torch_backend" != cpu ] || others='torch==|cuda|nvidia|triton=='
    # An entry ends where the next one begins, at the start of a line.
    awk -v others="^($others)" '/^[^ #]/ { other = $0 ~ others } !other' requirements.txt >"$pins"
    "$python" -m uv pip install --python "$python" --no-deps --torch-backend "$torch_backend" \
        "$(grep -o '^torch==[^ ]*' requirements.txt)" &&
        "$python" -m uv pip install --python "$python" --no-deps --require-hashes --requirement "$pins" && return
    say "torch could not be fetched for '$torch_backend', going on with the usual build (3 GB)" >&3
    return 1
}

# The pins are complete, so nothing is resolved (--no-deps), and nothing else is taken for them (--require-hashes).
install_with_uv() {
    {
        install_with_backend ||
            "$python" -m uv pip install --python "$python" --no-deps --require-hashes --requirement requirements.txt
    } && "$python" -m uv pip install --quiet --python "$python" --no-deps --no-build-isolation --editable .
}

install_with_pip() {
    "$python" -m pip install --quiet --no-deps --require-hashes --requirement requirements.txt &&
        "$python" -m pip install --quiet --no-deps --no-build-isolation --editable .
}

install_packages() {
    local count why has_uv=
    prepare_uv >>"$log" 2>&1 && has_uv=yes
    count=$(grep -c '^[a-z].*==' requirements.txt)
    if [ -n "$torch_backend" ]; then
        say "installing $count pinned packages, torch for '$torch_backend'"
    else
        say "installing $count pinned packages (the first time: 3 GB to download, 7 GB on disk)"
    fi
    # uv names large files as it begins to fetch them.
    [ -n "$has_uv" ] &&
        install_with_uv 2> >(tee -a "$log" | sed -un 's/^ *Downloading /set-up: downloading /p') 3>&1 >>"$log" && return
    say "uv did not get through, going on with pip (some minutes)"
    install_with_pip >>"$log" 2>&1 && return
    # What CMake remembers of a failure would fail again.
    rm -rf build
    why=$(grep -o 'anm-mj could not be compiled;.*' "$log" | tail -n 1)
    fail "${why:-packages could not be installed: $(grep -i error "$log" | tail -n 1)} (all of it: $log)"
}

# What the compiled module is built with.
prepare_compiler() {
    local include version
    command -v "${CXX:-c++}" >/dev/null || apt_install g++ ||
        fail "there is no C++ compiler; run: apt install g++ (or install another one for C++17), and call again."
    include=$("$python" -c 'import sysconfig; print(sysconfig.get_path("include"))')
    version=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
    [ -f "$include/Python.h" ] || apt_install "python$version-dev" ||
        fail "Python's header files are missing; run: apt install python$version-dev, and call again."
}

# Where Python may write no bytecode (PYTHONDONTWRITEBYTECODE, as images of containers have it), every command would
# compile again all that it imports: three seconds of a run.
compile_packages() {
    local site name
    local -a folders=("$PWD/anm_mj")
    [ -n "${PYTHONDONTWRITEBYTECODE:-}" ] || return 0
    site=$("$python" -c 'import sysconfig; print(sysconfig.get_path("purelib"))')
    for name in numpy scipy matplotlib mpl_toolkits pyparsing dateutil fontTools trimesh networkx skimage PIL mujoco mink \
        OpenGL shapely jaxtyping msgspec rich torch; do
        folders+=("$site/$name")
    done
    # Files that are no Python of this version, which packages hold for others, do not compile.
    "$python" -m compileall -q -j 0 "${folders[@]}" >/dev/null 2>&1 || true
}

# Prints the GL back-end that can make a picture; none: status 1.
find_backend() {
    "$python" -c 'from anm_mj.sim.gl import select_backend
backend = select_backend()
print(backend.name, f"({backend.renderer_string})" if backend.renderer_string else "")' 2>>"$log"
}

prepare_graphics() {
    local backend
    backend=$(find_backend) ||
        { apt_install libegl1 libgl1-mesa-dri && backend=$(find_backend); } ||
        # Distributions of 2025 and later have no OSMesa any more, so it comes last.
        { apt_install libosmesa6 && backend=$(find_backend); } ||
        fail "no GL back-end works; install one (apt install libegl1 libgl1-mesa-dri, or libosmesa6) and call again (what was tried: $log)."
    say "pictures are made with $backend"
}

if [ -f "$stamp" ] && [ "$(cat "$stamp")" = "$(state)" ] && "$python" -c '' 2>/dev/null && is_wanted; then exit 0; fi
{ "$python" -c 'import pip' 2>/dev/null && is_wanted; } || make_venv
: >"$log"
apt_log=$log
SECONDS=0
prepare_compiler
install_packages
compile_packages
prepare_graphics
[ -z "$asked_backend" ] || echo "$asked_backend" >"$venv/torch-backend"
state >"$stamp"
say "done in $SECONDS s"
