#!/bin/sh
# Make .venv from requirements.lock and compile the kernels, with a word at least every two seconds. Arguments: the
# interpreter.
set -eu
kernels=agent/__pycache__/kernels

tell() {
    began=$(date +%s)
    while sleep 1.5; do
        packages=$(find .venv -name '*.dist-info' -prune 2>/dev/null | wc -l)
        echo "  $(($(date +%s) - began)) s: $packages packages$([ ! -e $kernels ] || echo ", $(find $kernels -type f | wc -l) kernels")"
    done
}

by_pip() {
    .venv/bin/python -m pip install --quiet --disable-pip-version-check "$@"
}

# uv needs 4 s where pip needs 20, but knows nothing of another index that pip is told of.
by_uv() {
    ! .venv/bin/python -m pip config list | grep -q '\.index-url' || return 1
    sed -n '/^uv==/,/[^\\]$/p' requirements.lock > .venv/uv.txt
    by_pip --require-hashes --requirement .venv/uv.txt || return 1
    .venv/bin/uv pip install --quiet --python .venv/bin/python --system-certs --require-hashes --requirement requirements.lock
}

echo "installing $(grep -c == requirements.lock) packages into .venv, then compiling kernels"
tell &
trap 'kill '$! EXIT
"$@" -m venv .venv
by_uv || by_pip --no-compile --require-hashes --requirement requirements.lock   # bytecode of all would cost 7 s
by_pip --no-deps --no-build-isolation --editable .
.venv/bin/python -m agent.warmup
