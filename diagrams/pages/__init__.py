"""Web pages of an arm in motion, made by a headless Meshcat.

In: a robot, and postures, a motion, a path or points. Out: one HTML file that needs nothing else.
Order: run_page (Meshcat and the file), arm_picture and cell_picture (what is drawn), then the pages
motion_page, path_page and cloud_page.
"""
