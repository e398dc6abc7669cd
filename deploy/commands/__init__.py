"""The commands of `wireswarm`, by what they are for. What one needs beyond the base install it imports as it runs."""
