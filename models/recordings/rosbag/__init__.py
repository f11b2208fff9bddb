"""Logs in ROS 2 bags, read and written without ROS.

In: the path of a bag, or columns by name. Out: a table of numbers (`LogTable`), or an MCAP file.
Order: `bounded_bag` (opens), `messages` (decodes and encodes), `table` (rows and columns).
"""
