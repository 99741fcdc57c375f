"""Which law the heel pads of measured people follow: estimates, held-out predictions and the population."""
