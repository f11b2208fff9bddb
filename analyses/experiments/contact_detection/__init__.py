"""The experiment `contact-detection`.

`contact_free_twins` counts false alarms in simulated hours, `touched_links` checks the odds of
links; `experiment` does the rest and collects all figures.
"""
