"""What stands between an episode and its robots: the server, who takes part, and the network."""
