"""What all processes of a run have in common; imported once, by the server that they are forked from."""

from agent.warmup import rehearse

rehearse()
