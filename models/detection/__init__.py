"""Detection of contact: whether there is one, since when, and whether it is at E.

In: estimates of `estimation`. Out: a Detection per sample. Order of the files: `contact_detector`
sets the levels and runs the kernels of `contact_statistic`; `contact_noise_fit` learns its noise;
`tracked_estimator` adds tracked friction. `link_odds` and `pure_force` judge a contact's place.
`torque_contact` needs no model: it works on the controller's external torque.
"""
