"""An arch under a leg held against what others published: predictions, and proofs of what no arch can do."""
