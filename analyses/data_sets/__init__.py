"""Recordings of real robots: which sets there are, where they are on this computer, how to get one.

registry      what is known of each set; the published files of those that can be fetched
places        where a set is looked for, in which order: `data_set_folder`
fetching      published files into the user's cache
conversion    files that an experiment reads and nobody has published, made of published ones
"""
