"""The experiment `panda-wrench`."""
