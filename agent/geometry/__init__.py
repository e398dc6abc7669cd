"""Points, segments and rigid transforms in the plane."""
