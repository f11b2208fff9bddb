"""Updates of a known model: a model and logs of today in, the model with what has changed out.

Order: stretches (parts of logs), model_residual (what the model leaves of them),
friction_refreshing (`identify --refresh`), specimen_refitting (--other-specimen),
load_calibration (--load), scale_finding (--scale).
"""
