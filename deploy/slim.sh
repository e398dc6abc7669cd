#!/bin/sh
# Leave out of the installed packages in a folder what no program needs: tests, sources of extensions, symbols, and
# Python's sources beside their bytecode. A traceback still names file and line.
set -eu
cd "$1"
find . -type d \( -name tests -o -name test \) -prune -exec rm -r {} +
rm -rf numba/cuda numba/pycc numba/testing numpy/distutils numpy/f2py numpy/testing pydantic/v1 \
    numpy/_core/_simd.* numpy/_core/_*_tests.*
find . -type f \( -name '*.pyi' -o -name '*.pyx' -o -name '*.pxd' -o -name '*.h' -o -name '*.c' -o -name '*.cpp' \
    -o -name '*.a' \) -delete
find . -type f -name '*.so*' -exec eu-strip {} +   # wheels' own libraries no longer load after strip of binutils
/opt/venv/bin/python -m compileall -q -b .
find . -type f -name '*.py' -delete
