"""Why the resonance rises with the load: mechanisms held against the thesis, proofs of their analysis, a drop."""
