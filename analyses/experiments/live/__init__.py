"""The experiment `live`."""
