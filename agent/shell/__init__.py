"""What stands between a mind and its body: processes and networks."""
