"""The simulated true robot: what its joints do that no model here contains, and its fast logs."""
