"""Experiments about the simulated truth itself: is it like a real arm?"""
