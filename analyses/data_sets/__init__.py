"""Recordings of real robots. In: the name of a set. Out: its folder on this computer.

registry      the sets: robot, licence, source; the published files of those that can be fetched
advice        how a user gets a missing set
places        where a set is looked for, in which order: `data_set_folder`
fetching      published files into the user's cache
conversion    files that an experiment reads and nobody has published, made of published ones
"""
