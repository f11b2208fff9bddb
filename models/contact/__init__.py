"""The force of a tool on a workpiece of known direction (`estimate --contact-axis`).

In: motion, motor torque and the estimator's reading of a log. Out: wrench at the contact, with its
covariance. Order: contact_filter (the model of the contact), contact_reading (a log in parts).
"""
