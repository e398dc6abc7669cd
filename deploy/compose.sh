#!/bin/sh
# A world and its robots in containers, to the end; the run directory is made in ./runs by the user who asks.
set -eu
cd "$(dirname "$0")/.."
compose="docker compose"
docker compose version >/dev/null 2>&1 || compose=docker-compose
command -v docker >/dev/null && docker info >/dev/null 2>&1 || { echo "no container engine runs here: start Docker" >&2; exit 1; }
mkdir -p runs
export RUNS="$PWD/runs" RUN_AS="$(id -u):$(id -g)" ROBOTS="${ROBOTS:-3}"
trap '$compose --file deploy/compose.yaml down --volumes --timeout 5' EXIT
$compose --file deploy/compose.yaml up --build --exit-code-from world
