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

echo "installing $(grep -c == requirements.lock) packages into .venv, then compiling kernels"
tell &
trap 'kill '$! EXIT
"$@" -m venv .venv
pip=".venv/bin/python -m pip install --quiet --disable-pip-version-check"
$pip --no-compile --require-hashes --requirement requirements.lock   # bytecode of what is never imported costs 7 s
$pip --no-deps --no-build-isolation --editable .
.venv/bin/python -m agent.warmup
