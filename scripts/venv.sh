# Sourced by scripts/demo and scripts/test, in the repository's root.
#
#   make_venv DIRECTORY [PIP-ARGUMENT…]
#
# A virtual environment with ledpi and what its checks need. It is kept until its inputs change: the interpreter,
# pyproject.toml, the C sources, the arguments. PYTHON=python3.12 chooses another interpreter. Needs no root.

make_venv() {
    local venv=$1 python=${PYTHON:-python3} wanted
    shift
    if ! "$python" -c 'import sys, ensurepip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
        echo "$0: $python must be Python 3.11 or newer with venv (Debian: apt install python3-venv)" >&2
        exit 2
    fi
    wanted=$("$python" -c 'import sys; print(sys.executable, sys.version)'; cat pyproject.toml constraints/* setup.py ledpi/kernels/*.[ch]; echo "$@")
    if [[ ! -f $venv/inputs || $(<"$venv/inputs") != "$wanted" ]]; then
        echo "$0: installing into $venv (once; a minute or so)" >&2
        "$python" -m venv --clear "$venv"
        "$venv/bin/pip" install --quiet --disable-pip-version-check "$@" --editable '.[dev]'
        printf '%s\n' "$wanted" >"$venv/inputs"
    fi
}
