"""Recordings of a NEURA LARA 8 in; the wrench from its motor torque, against a sensor, out."""
