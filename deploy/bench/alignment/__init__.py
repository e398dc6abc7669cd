"""`wireswarm bench alignment`: pairs of partial maps, our features against 4PCS and ICP, and robots that merge."""
