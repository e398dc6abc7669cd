"""`wireswarm bench radio`: bytes of maps on the radio, what a bad radio does to them, and what the radio costs."""
