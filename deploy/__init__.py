"""How wireswarm is run and looked at: command line, launcher, report, benchmarks."""
