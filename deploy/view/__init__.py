"""A run as a picture that moves, in the browser: live beside a running world, or replayed from its run directory."""
