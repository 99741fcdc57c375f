"""Legs, strikes, shakers, boards and sound cards whose truth is known, sharing no code with what they judge.

The arch is the exception: `arch`, `mounted`, `mount` and `bends` are built on fasbody.arch, and mounted_arch.xml and
foot_arch_bent.xml are made of them.
A checkout's tool for tests and benchmarks; not part of the installed package.
"""
