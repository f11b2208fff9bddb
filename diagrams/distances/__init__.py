"""How near links, tool, floor and workpiece come to each other."""
