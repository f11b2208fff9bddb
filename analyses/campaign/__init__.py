"""Experiments in many worlds: what runs them, keeps what they measured and shows the spread."""
