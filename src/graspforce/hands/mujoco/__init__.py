"""Hands and grasps read from MuJoCo models and simulations."""
