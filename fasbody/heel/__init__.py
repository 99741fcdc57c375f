"""Heel strikes of people: from the volts of a force plate and two markers to force over compression, and its laws."""
