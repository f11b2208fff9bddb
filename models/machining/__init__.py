"""Machining passes: their plan, their phases, their process forces."""
