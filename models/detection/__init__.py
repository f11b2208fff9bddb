"""Detection of contact: whether there is one, since when, and whether it is at E.

In: estimates of `estimation`. Out: a Detection per sample. `contact_decision` is the rule when a
contact begins and ends, on the norms of `contact_statistic`; `contact_detector` sets the levels and
runs the kernels for an estimator; `contact_noise_fit` learns the noise without contact;
`tracked_estimator` adds tracked friction. `link_odds` and `pure_force` judge a contact's place.
`torque_contact` needs no model: it works on the controller's external torque.
"""
