"""Chapter 2: transmissibility and phase of a study, by pair, load and posture; `fasbody transmissibility`.

Pairs: MB malleolus over base, TB tuberosity over base, TM tuberosity over malleolus.
"""
