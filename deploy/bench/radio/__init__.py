"""`wireswarm bench radio`: bytes of maps on the radio, what a bad radio does to them, and what the radio costs."""

from deploy.bench.benchmark import Benchmark
from deploy.bench.radio import codec, cost, traffic

BENCHMARK = Benchmark("radio", (codec, traffic, cost))
