"""Sensors, filters and statistics of signals.

In and out: arrays of samples. Order: sensors (gaussian_noise, current_measurement, tool_contact,
tool_wrench); filters (first_order, low_pass, undone_low_pass, zero_phase); root_mean_square, bands
and exceedance_tail (how far a statistic goes by chance).
"""
