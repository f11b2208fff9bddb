"""Experiments with recordings of other real arms than the UR10e: Panda, LARA 8, TX40."""
