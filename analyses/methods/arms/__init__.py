"""Descriptions of new arms, drafted from their URDF."""
