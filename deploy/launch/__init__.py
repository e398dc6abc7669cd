"""One process for the world and one for each robot: how they are started, watched and ended."""
