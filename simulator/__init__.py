"""Legs, strikes, shakers, boards and sound cards whose truth is known, sharing no code with what they judge.

The arch under a leg (`mounted`) is the closed form that mounted_arch.xml is made of.
A checkout's tool for tests and benchmarks; not part of the installed package.
"""
