#!/bin/sh
# A world and its robots in containers, to the end; the run directory is made in ./runs by the user who asks.
set -eu
cd "$(dirname "$0")/.."
command -v docker >/dev/null && docker info >/dev/null 2>&1 || { echo "no container engine runs here: start Docker" >&2; exit 1; }
compose="docker compose"
docker compose version >/dev/null 2>&1 || compose=docker-compose
compose="$compose --file deploy/compose.yaml"
mkdir -p runs
RUN_AS="$(id -u):$(id -g)"
if [ "$(id -u)" = 0 ]; then   # nothing runs as root in a container
    RUN_AS=10001:10001
    chown "$RUN_AS" runs
fi
export RUN_AS RUNS="$PWD/runs" ROBOTS="${ROBOTS:-3}" SETTLE="${SETTLE:-120}"
end() {
    $compose down --timeout 5   # not --volumes: there may be runs and results of earlier ones in them
    docker volume rm --force "${COMPOSE_PROJECT_NAME:-deploy}_secrets" >/dev/null
}
trap end EXIT
trap 'exit 130' INT    # dash, killed by a signal, would not come to the trap of EXIT
trap 'exit 143' TERM
trap 'exit 129' HUP
$compose up --build   # not --exit-code-from: it would stop the world when the first robot leaves
exit "$(docker inspect --format '{{.State.ExitCode}}' "$($compose ps --quiet --all world)")"
