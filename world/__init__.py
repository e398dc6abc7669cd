"""The truth: world files, physics, lidar, radio, people and coverage."""
