"""The command `simulate`: a scenario in, the signals and errors of a simulated arm out.

Order: simulate_settings, simulated_logs (excitation of a simulated arm), fast_runs (free motion
without contact), advance (a simulation to its end), air_pass (the correction that machining learns
before contact), run_faults (saturated joints, models that move no arm, divergence), simulation,
simulation_result (figures and files).
"""
