"""`wireswarm bench exploration`: whether exploration finishes, what it costs, and the bars it must meet."""
