"""Hands and grasps read from URDF files and Pinocchio models."""
