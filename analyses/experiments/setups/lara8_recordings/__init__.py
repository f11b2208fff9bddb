"""Recordings of a NEURA LARA 8, and how its motor torque is read."""
