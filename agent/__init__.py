"""One robot's mind: scan to corners, wireframe, filter, alignment, exploration, driving."""
