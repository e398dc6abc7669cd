"""`wireswarm bench exploration`: whether exploration finishes, what it costs, and the bars it must meet."""

from deploy.bench.benchmark import Benchmark
from deploy.bench.exploration import dense, mazes, policies, runs, speed, teams, tours

BENCHMARK = Benchmark("exploration", (runs, teams, mazes, policies, tours, dense, speed))
