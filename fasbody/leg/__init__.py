"""The leg above the foot: a chain of masses on the shaker, and why its resonance moves with the load."""
