"""What a reading says about contact: that there is one, since when, and whether it is at E."""
