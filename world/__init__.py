"""The truth: world files, physics, lidar, radio, clock and coverage."""
