"""`wireswarm bench filter`: what the particle filter shows, and the bars it must meet."""

from deploy.bench import speed
from deploy.bench.benchmark import Benchmark
from deploy.bench.filter import ambiguous, cost, runs, storage, sweep, trials

BENCHMARK = Benchmark("filter", (runs, trials, ambiguous, storage, speed, cost, sweep))
