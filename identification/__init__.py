"""Estimation of foot and ankle parameters from measured accelerations."""
