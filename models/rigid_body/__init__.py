"""Rigid-body mathematics: arrays in, arrays out, and no knowledge of files."""
