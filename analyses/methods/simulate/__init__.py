"""The command `simulate`: a scenario in, what a simulated arm and its estimator do out.

Order: simulate_settings, simulated_logs (excitation of a simulated arm), fast_runs (free motion
without contact), advance (a simulation to its end), air_pass (the pass that machining learns from),
simulation, simulation_result (figures and files).
"""
