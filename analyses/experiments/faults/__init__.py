"""The experiment `faults`: damage done to real recordings, and what is read then."""
