"""The true robot's joints in its cell: drives, friction and encoders between command and plant."""
