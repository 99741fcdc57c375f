"""Legs, strikes, shakers, boards and sound cards whose truth is known, sharing no code with what they judge.

A checkout's tool for tests and benchmarks; not part of the installed package.
"""
