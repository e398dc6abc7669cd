"""`wireswarm bench filter`: what the particle filter shows, and the bars it must meet."""
