"""A whole study: every subject, load and frequency fitted, on one machine or a cluster, and what came out of it."""
