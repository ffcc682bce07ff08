# Sourced by scripts/demo and scripts/test, in the repository's root.
#
#   make_venv DIRECTORY EXTRA [PIP-ARGUMENT…]
#
# A virtual environment with ledpi and what EXTRA of pyproject.toml names: "" for what ledpi itself needs, "dev" for its
# checks. It is kept until its inputs change: the interpreter, pyproject.toml, the C sources, the arguments; a further
# extra is added to it. PYTHON=python3.12 chooses another interpreter. Needs no root where a C compiler is there.

# What ledpi's C core is built with: a compiler, C's headers and Python's. Root gets them from Debian.
bring_compiler() {
    local include packages="gcc libc6-dev python3-dev"
    include=$("$1" -c 'import sysconfig; print(sysconfig.get_path("include"))')
    if command -v gcc >/dev/null && [[ -e /usr/include/stdio.h && -e $include/Python.h ]]; then return; fi
    if [[ $EUID != 0 ]] || ! command -v apt-get >/dev/null; then
        echo "$0: needs a C compiler, and C's and Python's headers (Debian: apt install $packages)" >&2
        exit 2
    fi
    apt-get update -qq
    DEBIAN_FRONTEND=noninteractive apt-get install -qq -y --no-install-recommends $packages >/dev/null
}

make_venv() {
    local venv=$1 extra=$2 python=${PYTHON:-python3} wanted
    shift 2
    if ! "$python" -c 'import sys, ensurepip; sys.exit(sys.version_info < (3, 10))' 2>/dev/null; then
        echo "$0: $python must be Python 3.10 or newer with venv (Debian: apt install python3-venv)" >&2
        exit 2
    fi
    # Of an activated environment the Python that made it: it is not cleared because it runs, nor made of itself.
    python=$("$python" -c 'import os, sys; print(os.path.realpath(sys._base_executable))')
    bring_compiler "$python"
    wanted=$("$python" -c 'import sys; print(sys.executable, sys.version)'; cat pyproject.toml constraints/* setup.py build_core.py $(find ledpi -name "*.[ch]" | LC_ALL=C sort); echo "$@")
    if [[ ! -f $venv/inputs || $(<"$venv/inputs") != "$wanted" ]]; then
        "$python" -m venv --clear "$venv"
    fi
    if [[ ! -f $venv/has-$extra && (-n $extra || ! -f $venv/inputs) ]]; then
        install_into "$venv" "$extra" "$@"
        touch "$venv/has-$extra"
    fi
    printf '%s\n' "$wanted" >"$venv/inputs"
}

# By uv where it is there or can be had, as it takes a fifth of pip's time; by pip otherwise, or where uv fails. Python
# compiles what it imports, pip would compile a gigabyte. `compat`: the folder itself is on Python's path, where pyright
# and editors find ledpi, too.
install_into() {
    local venv=$1 extra=$2 quiet=() uv arguments
    shift 2
    [[ -t 2 ]] || quiet=(--quiet)
    echo "$0: installing ${extra:+the $extra tools }into $venv (once; a minute or so)" >&2
    uv=$(command -v uv || true)
    if [[ -z $uv ]] && "$venv/bin/pip" install --quiet --disable-pip-version-check --no-compile uv 2>/dev/null; then
        uv=$venv/bin/uv
    fi
    arguments=("${quiet[@]}" "$@" --config-settings editable_mode=compat --editable ".${extra:+[$extra]}")
    if [[ -n $uv ]] && "$uv" pip install --python "$venv/bin/python" "${arguments[@]}" >&2; then return; fi
    "$venv/bin/pip" install --disable-pip-version-check --no-compile "${arguments[@]}" >&2
}
