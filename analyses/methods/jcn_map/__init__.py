"""The command `jcn-map`: a robot in, statistics and a slice of its condition number out.

Order: jcn_map_settings, jcn_map.
"""
