"""Experiments in many worlds: drawn arms in, the spread of the experiments' figures out.

Order: campaign_options (command line), world_run (one world), workers (processes or a cluster),
campaign_store (what worlds measured, on disk), distributions and influences (the spread, and which
draws move it), campaign_report (page), campaign (all of it).
"""
