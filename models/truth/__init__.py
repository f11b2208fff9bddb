"""The simulated true robot: its joints, with effects that no model here contains; fast logs."""
