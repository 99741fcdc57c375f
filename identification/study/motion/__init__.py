"""Pictures of single cycles: traces, hysteresis loops and their energies."""
