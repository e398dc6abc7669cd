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

pip() {
    .venv/bin/python -m pip install --quiet --disable-pip-version-check "$@"
}

uv() {
    .venv/bin/uv pip install --quiet --python .venv/bin/python --system-certs "$@"
}

# uv needs 4 s where pip needs 20, but knows nothing of another index that pip is told of.
has_uv() {
    ! .venv/bin/python -m pip config list | grep -q '\.index-url' || return 1
    sed -n '/^uv==/,/[^\\]$/p' requirements.lock > .venv/uv.txt
    pip --require-hashes --requirement .venv/uv.txt && uv --require-hashes --requirement requirements.lock
}

echo "installing $(grep -c == requirements.lock) packages into .venv, then compiling kernels"
tell &
trap 'kill '$! EXIT
"$@" -m venv .venv
installer=uv
has_uv || { installer=pip; pip --no-compile --require-hashes --requirement requirements.lock; }   # bytecode of all: 7 s
$installer --no-deps --no-build-isolation --editable .
.venv/bin/python -m agent.warmup
