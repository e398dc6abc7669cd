"""What the robots' lidars measure: true ranges, cast exactly, and the readings that a sensor makes of them."""
