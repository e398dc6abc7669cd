"""`wireswarm bandwidth`: what a run's robots sent, and what their maps would have cost in other forms."""
