"""Systems of the simulated true robot: no controller or estimator may see inside them."""
