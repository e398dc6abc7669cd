"""`wireswarm bench alignment`: pairs of partial maps, our features against 4PCS and ICP, and robots that merge."""

from deploy.bench.alignment import cost, forced, hostile, live, plots, trials
from deploy.bench.benchmark import Benchmark

BENCHMARK = Benchmark("alignment", (trials, cost, live, forced, hostile), trials.recorded, plots.draw)
