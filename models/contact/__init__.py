"""The force of a tool on a workpiece, from joint torques, by a filter that models the contact."""
