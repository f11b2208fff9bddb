"""Live streams of a robot: samples of a controller in, readings and events out.

Order of the files: source (what gives samples; rtde is a wire format), samples, stream_order (in
order, on a grid), live_estimator (reads them; external_torque, known_contact), reading (one row),
event_gate (which events are passed on).
"""
