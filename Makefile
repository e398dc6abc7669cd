# wireswarm on a fresh Debian machine: python3, venv, git and make are enough.

PYTHON ?= python3
ARGS ?=
SECONDS ?= 60
BIN := .venv/bin
INSTALLED := .venv/.installed

# Small arrays: threads of the numeric libraries only wait for each other.
export OPENBLAS_NUM_THREADS := 1
export OMP_NUM_THREADS := 1
# Written once, bytecode halves the time in which each process starts, whatever the machine has set.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: help install run test system fuzz check format lock compose

help: ## list the targets
	@sed -nE 's/^([a-z]+):[^#]*## (.*)/make \1 \t\2/p' $(MAKEFILE_LIST) | expand -t 16

install: $(INSTALLED) ## make .venv from requirements.lock

# A file, so that nothing is installed twice: only a newer lock or pyproject brings it up again.
$(INSTALLED): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.version_info >= (3, 11) or sys.exit("wireswarm needs Python 3.11 or newer")'
	@deploy/install.sh $(PYTHON)
	@touch $@

run: $(INSTALLED) ## three robots map the maze (more options: make run ARGS="--seed 1")
	$(BIN)/wireswarm run --world maze-15 --robots 3 $(ARGS)

test: $(INSTALLED) ## run the tests, but for those of `make system` (make test ARGS="-k report")
	$(BIN)/python -m pytest -n 2 -m "not slow and not system" $(ARGS)

system: $(INSTALLED) ## run the tests with processes, signals, whole runs and logs
	$(BIN)/python -m pytest -n 2 -m "system and not slow" $(ARGS)

fuzz: $(INSTALLED) ## fuzz every decoder and loader for SECONDS each (make fuzz SECONDS=10 ARGS="messages worlds")
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes --only-binary :all: \
		-r tests/fuzz/requirements.txt || echo "atheris has no wheel for this Python"
	$(BIN)/python -m tests.fuzz $(SECONDS) $(ARGS)

check: $(INSTALLED) ## lint, format, types, import rules
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports

format: $(INSTALLED) ## bring the sources into shape
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

# No index in them: locks hold names, versions and hashes, good for any mirror and platform. The image takes what it
# needs, in the versions of requirements.lock.
COMPILE = $(BIN)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-emit-index-url \
	--no-emit-find-links --custom-compile-command "make lock"

# What Typer asks for and a robot's command line does without.
NOT_IN_AGENT = rich pygments markdown-it-py mdurl
# Images take the versions of requirements.lock, but of LLVM, their bulk, a leaner one (deploy/locks/lean.txt).
VERSIONS = .venv/versions.txt
COMPILE_LEAN = $(COMPILE) pyproject.toml --constraints $(VERSIONS) --constraints deploy/locks/lean.txt

lock: $(INSTALLED) ## resolve pyproject.toml into requirements.lock and deploy/locks anew
	$(COMPILE) pyproject.toml --upgrade --all-extras --output-file requirements.lock
	sed '/^\(llvmlite\|numba\|numpy\)==/,/[^\\]$$/d' requirements.lock > $(VERSIONS)
	$(COMPILE_LEAN) --extra world --extra deploy --output-file deploy/locks/world.lock
	$(COMPILE_LEAN) --extra world --extra deploy --extra sweep --output-file deploy/locks/sweep.lock
	$(COMPILE_LEAN) $(NOT_IN_AGENT:%=--no-emit-package %) --output-file deploy/locks/agent.lock
	echo hatchling | $(COMPILE) - --constraints requirements.lock --output-file deploy/locks/build.lock

compose: ## a world and three robots in containers, to the end (make compose ROBOTS=5)
	ROBOTS=$(or $(ROBOTS),3) deploy/compose.sh
