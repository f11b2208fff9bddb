"""Logs in bags of ROS 1 and ROS 2, read and written without ROS.

In: the path of a bag, or columns by name. Out: a table of numbers (`LogTable`), or an MCAP file.
Order: `messages` (numbers of messages), `bounded_bag` (opens), `table` (rows and columns).
"""
