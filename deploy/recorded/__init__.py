"""Recorded lidar logs in place of the world."""
