"""`wireswarm bench exploration`: whether exploration finishes, what it costs, and the bars it must meet."""

from deploy.bench import speed
from deploy.bench.benchmark import Benchmark
from deploy.bench.exploration import dense, mazes, runs, teams, tours

BENCHMARK = Benchmark("exploration", (runs, teams, mazes, tours, dense, speed))
