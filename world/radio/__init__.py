"""What of the robots' messages arrives: the gate that all of them pass, and models of the air."""
